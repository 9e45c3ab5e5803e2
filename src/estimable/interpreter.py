"""The Python that estimable needs: one that runs with its global lock."""

import sys

if not getattr(sys, "_is_gil_enabled", lambda: True)():
    raise ImportError(
        "estimable does not run in Python without the global interpreter lock: its machine code and caches share memory between "
        "threads. Start Python with PYTHON_GIL=1 or -X gil=1; machine code releases the lock and uses all processors anyway."
    )
