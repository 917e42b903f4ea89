"""Checks of arguments, names, files and optional packages, for every other room."""
