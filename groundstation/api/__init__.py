"""The library: replay a session to arrays, or feed a tracker event by event (docs/python.md)."""
