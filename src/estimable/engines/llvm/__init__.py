"""Programs as LLVM assembly, and the machine code compiled from it."""
