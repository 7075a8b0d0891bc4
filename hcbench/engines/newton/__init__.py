"""Newton: rigid bodies on GPUs by Warp, in float32."""
