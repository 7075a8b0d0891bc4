"""Bounces that engines should get right: the cases, their runner, adapters of engines, and scores."""
