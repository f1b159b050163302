"""Reading and writing files within budgets: TOML, CSV and text, pictures' headers, names and paths that are safe."""
