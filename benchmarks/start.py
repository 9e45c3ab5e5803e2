"""W9: seconds from a cold start, of whole processes."""

import os
import subprocess
import sys
import tempfile
import time

from .common import row


def starts(name):
    """Imports, and the demo in a new process, whose machine code may be on the disk."""

    environment = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}

    def process(code):
        with tempfile.TemporaryDirectory() as folder:
            start = time.perf_counter()
            subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, cwd=folder, env=environment)
            return time.perf_counter() - start

    jax, ours = (min(process(f"import {module}") for _ in range(3)) for module in ("jax", "estimable"))
    demo = process("import sys; sys.argv=['estimable','demo','--json']; from estimable.commands import main; main()")
    yield row(name, "import estimable", ours)
    yield row(name, "import jax", jax)
    yield row(name, "estimable demo, a new process", demo)
