"""Inter-reflection on a sphere, scatter kernels, response and transfer functions, the box-limited solve."""
