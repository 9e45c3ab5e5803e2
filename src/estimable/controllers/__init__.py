"""Controllers, from an estimate and a reference to an input: `init()`, then `act(state, estimate, reference)` at each sample."""
