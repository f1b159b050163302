def remade(*a): return []
