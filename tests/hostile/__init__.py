"""Malicious files: each reader refuses or reads them in bounded memory and time."""
