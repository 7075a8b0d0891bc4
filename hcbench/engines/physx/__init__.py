"""PhysX 5 through SAPIEN: rigid contact with a restitution, in float32."""
