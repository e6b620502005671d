"""Many trials at once: grid and random sweeps of binding and of driving, batched, spread over processes or machines."""
