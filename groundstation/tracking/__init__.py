"""From events to the track: synchronise, predict, look, update, report; the one place where the order is written."""
