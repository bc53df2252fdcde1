"""How files that input names are read, and how results are written whole."""
