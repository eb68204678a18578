"""Scores pictures against their targets, in an environment of its own; nothing of procam is imported.

    judge-env/bin/python studies/picture_judge.py PICTURES.npz

PICTURES.npz holds for each name NAME|target and NAME|observed: (H, W, 3) linear light, 1.0 is white. Prints a
line of JSON: for each name ColorVideoVDP (JOD, 10 is no visible difference) under four viewing conditions and
their mean, PU21-PSNR of luminance, SSIM of log luminance, and FLIP (0 is the same). To make the environment:

    python3 -m venv judge-env
    judge-env/bin/pip install torch==2.13.0
    judge-env/bin/pip install -r studies/picture_judge_requirements.txt
    judge-env/bin/pip install --no-deps cvvdp==0.5.7
"""

import json
import logging
import sys
import types
import warnings

import numpy as np

CONDITIONS = ((50.0, 10.0), (14.0, 20.0), (14.0, 45.0), (5.0, 30.0))  # white cd/m2, px per degree
WHITE = 14.0  # cd/m2, for PU21 and SSIM
LUMA = np.array([0.2126, 0.7152, 0.0722])
PU21 = (
    *(0.353487901, 0.3734658629, 8.277049286e-05, 0.9062562627),
    *(0.09150303166, 0.9099517204, 596.3148142),
)


def stand_in_for_torchvision():
    """ColorVideoVDP needs two names of torchvision, which is not built for every platform."""
    import torch  # noqa: PLC0415

    class GaussianBlur:
        def __init__(self, kernel_size, sigma):
            self.size, self.sigma = kernel_size, sigma

        def __call__(self, x):
            half = (self.size - 1) / 2
            at = torch.linspace(-half, half, self.size, device=x.device, dtype=x.dtype)
            g = torch.exp(-0.5 * (at / self.sigma) ** 2)
            g = g / g.sum()
            pad = (self.size // 2,) * 4
            y = torch.nn.functional.pad(x.reshape(-1, 1, *x.shape[-2:]), pad, mode="reflect")
            down = torch.nn.functional.conv2d(y, g.view(1, 1, 1, -1))
            return torch.nn.functional.conv2d(down, g.view(1, 1, -1, 1)).reshape(x.shape)

        forward = __call__

    root, transforms, ops = (
        types.ModuleType(name)
        for name in ("torchvision", "torchvision.transforms", "torchvision.ops")
    )
    transforms.GaussianBlur, ops.MLP = GaussianBlur, torch.nn.Sequential
    root.transforms, root.ops = transforms, ops
    sys.modules.update({module.__name__: module for module in (root, transforms, ops)})


def jod(observed, target, white, pixels_per_degree):
    """Quality of a picture on a display without limits."""
    import pycvvdp  # noqa: PLC0415
    from pycvvdp.display_model import (  # noqa: PLC0415
        vvdp_display_geometry,
        vvdp_display_photo_eotf,
    )

    light = vvdp_display_photo_eotf(1000.0, contrast=1e7, EOTF="linear", source_colorspace="sRGB")
    place = vvdp_display_geometry(observed.shape[1::-1], ppd=pixels_per_degree)
    metric = pycvvdp.cvvdp(display_photometry=light, display_geometry=place, heatmap=None)
    pair = [(picture * white + 1e-3).astype(np.float32) for picture in (observed, target)]
    return float(metric.predict(*pair, dim_order="HWC")[0])


def pu21(nits):
    """PU21 units of luminance."""
    v = np.clip(nits, 0.005, 1e4) ** PU21[3]
    share = (PU21[0] + PU21[1] * v) / (1 + PU21[2] * v)
    return np.maximum(PU21[6] * (share ** PU21[4] - PU21[5]), 0)


def score(target, observed):
    """All measures of one picture."""
    from flip_evaluator import evaluate  # noqa: PLC0415
    from skimage.metrics import structural_similarity  # noqa: PLC0415

    found = {f"{w:g} cd/m2, {p:g} px/deg": jod(observed, target, w, p) for w, p in CONDITIONS}
    found["jod"] = float(np.mean(list(found.values())))
    luma = [picture @ LUMA * WHITE for picture in (observed, target)]
    error = ((pu21(luma[0]) - pu21(luma[1])) ** 2).mean()
    found["pu21_psnr_db"] = float(10 * np.log10(pu21(np.array(WHITE)) ** 2 / max(error, 1e-12)))
    found["log_ssim"] = float(
        structural_similarity(
            *(np.log10(np.maximum(plane, 0) + 0.01) for plane in luma),
            data_range=np.log10(WHITE + 0.01) + 2,
            gaussian_weights=True,
            sigma=1.5,
            use_sample_covariance=False,
        )
    )
    codes = [srgb(picture) for picture in (target, observed)]
    found["flip"] = float(evaluate(*codes, "LDR")[1])
    return found


def srgb(light):
    """Encoded values of light, clipped to 0..1."""
    v = np.clip(light, 0, 1)
    curve = 1.055 * np.maximum(v, 1e-9) ** (1 / 2.4) - 0.055
    return np.where(v <= 0.0031308, 12.92 * v, curve).astype(np.float32)


def main():
    """Score the pictures of a file."""
    warnings.filterwarnings("ignore")
    logging.disable(logging.CRITICAL)
    stand_in_for_torchvision()
    with np.load(sys.argv[1]) as file:
        names = sorted({key.rsplit("|", 1)[0] for key in file})
        found = {n: score(file[f"{n}|target"], file[f"{n}|observed"]) for n in names}
    print(json.dumps(found))


if __name__ == "__main__":
    main()
