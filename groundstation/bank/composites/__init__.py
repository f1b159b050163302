"""Composites: drawn aircraft over the frames of real clips, with exact truth and the clip's light and blur."""
