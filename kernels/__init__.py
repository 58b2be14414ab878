"""NVIDIA Warp kernels: arrays in, arrays out."""
