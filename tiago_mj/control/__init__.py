"""Controllers that are not learned."""
