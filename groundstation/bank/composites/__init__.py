"""Drawn aircraft over real pictures: sequences with exact truth whose background, light and blur are a real clip's."""
