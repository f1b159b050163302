"""Tests of drawn aircraft over real pictures."""
