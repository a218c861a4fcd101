"""From a scene to a world: survey, plan, leaves, parents, index."""
