"""What the build of the documentation adds to the pages: figures, mathematics, lists."""
