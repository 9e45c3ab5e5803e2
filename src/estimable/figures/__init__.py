"""Result in, figure out. Nothing here is loaded before a figure is asked for."""
