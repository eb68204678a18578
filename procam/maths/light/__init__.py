"""Light as arrays: inter-reflection on a sphere, the scatter kernel, response and transfer functions.

`radiosity` and `scatter_kernel` add and remove inter-reflection (docs/theory/interreflection.md);
`box_solver` finds direct light within limits for a wanted total (docs/theory/compensation.md).
"""
