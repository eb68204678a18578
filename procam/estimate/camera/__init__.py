"""What one camera does to light: exposure, noise, response, HDR merging, glare and vignetting."""
