"""Reading of input files, numbers and stamps in their lines, and atomic writing of results."""
