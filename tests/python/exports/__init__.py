"""Common parts of the tests of exports: models, points, and an evaluator of exported models."""
