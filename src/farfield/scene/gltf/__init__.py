"""glTF 2.0 and GLB: container, accessors, Draco, materials, nodes."""

from farfield.scene.gltf.read import GltfMesh, read_gltf

__all__ = ["GltfMesh", "read_gltf"]
