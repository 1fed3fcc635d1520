"""From scan, photographs or examples to the actor's rig."""
