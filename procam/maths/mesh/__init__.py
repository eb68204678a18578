"""Ray casting, form factors and radiosity on triangle meshes."""
