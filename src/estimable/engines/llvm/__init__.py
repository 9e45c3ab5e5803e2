"""Programs as LLVM's assembly, and machine code made of it."""
