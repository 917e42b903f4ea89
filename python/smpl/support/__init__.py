"""Checks of arguments, names, files and optional packages: used by every other part, and using none of them."""
