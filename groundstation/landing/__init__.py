"""The approach and the landing: glide path, touchdown foretold, landing reports."""
