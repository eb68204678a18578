"""What screen, projectors and room do to light: separation, scatter, albedo, response, blending."""
