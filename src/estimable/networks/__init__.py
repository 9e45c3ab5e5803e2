"""What a link does to packets. `init()`, then `send(state, packet, draw)` at each instant; the draws come from the driver."""
