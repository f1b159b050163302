"""Worlds drawn at random: one seed gives airframe, scenery, sky, traffic, cameras, stations and flight.

`draw_world` draws one, `world_text` and `load_world` write and read it, `render_world` films it.
"""
