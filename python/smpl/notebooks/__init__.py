"""Notebooks: the live page and the cell magic."""
