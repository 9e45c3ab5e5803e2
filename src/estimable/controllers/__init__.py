"""What an input is made of an estimate and a reference: `init()`, then `act(state, estimate, reference)` at each sample."""
