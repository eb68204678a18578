"""One camera's photometry: noise, exposures, merging, response, veiling glare and vignetting.

`noise` and `exposure` plan photographs, `hdr` merges them, `radiance` converts counts to radiance;
`response`, `linearity`, `glare_and_vignetting` and `checks` measure what that conversion needs.
"""
