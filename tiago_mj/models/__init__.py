"""The robots: names, files, limits, meshes, converter."""
