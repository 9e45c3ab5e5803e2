"""Links that lose or delay packets: `init()`, then `send(state, packet, draw)` at each instant; the driver makes the draws."""
