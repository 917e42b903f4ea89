"""What the tests of exports share: models, points, and an evaluator of exported models."""
