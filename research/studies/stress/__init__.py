"""Hard cases for a splatting backend, each held to a bound of its own against the float64 twin, and does training drift?"""
