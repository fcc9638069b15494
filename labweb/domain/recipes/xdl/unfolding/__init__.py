"""A recipe with nothing left open: blueprints, amounts and acts worked out."""
