"""Long simulated drives with faults of chance: does the car stop for each in time, and for nothing else?"""
