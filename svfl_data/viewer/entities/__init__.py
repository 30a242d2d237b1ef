"""What the viewer shows of an episode, entity by entity: cameras, curves, robot, scene, and any declared field."""
