"""Two meshes into a scene image: `bake` calls surface, shell, voxmap and layout in this order."""
