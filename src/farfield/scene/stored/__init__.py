"""Parts of a scene as values in a world's store, so that neither memory nor the source is needed to bake them again."""
