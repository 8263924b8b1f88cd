#!/usr/bin/env python3
"""PEN's maps and coordinates as PyTorch computes them, for tests/model.rs.

Set-up:  python3 -m venv V && V/bin/pip install torch timm safetensors numpy
Use:     V/bin/python tests/golden/pen.py          (writes the files beside this script)

The published network has 18 M parameters, too many to commit: weights, and the picture, come from a formula that both
sides compute (`values`), by tensor name. The backbones are timm's own `resnet34`, `convnext_nano` and `convnextv2_nano`; their tensor names and shapes are
written too, so that the Rust test loads a file with exactly timm's names.
"""
import json
import os

import numpy as np
import timm
import torch
from safetensors.torch import save_file
from torch import nn
from torch.nn import functional as F

HERE = os.path.dirname(os.path.abspath(__file__))
HEIGHT, WIDTH = 64, 96
COMPACT = {"stem": 6, "stages": [6, 8, 10, 12], "pyramid": 8, "prior_depth": 7.5}


def values(name, count):
    """`count` numbers in [-1, 1): SplitMix64 over FNV-1a of the name."""
    state = 0xCBF29CE484222325
    for byte in name.encode():
        state = ((state ^ byte) * 0x100000001B3) % 2**64
    with np.errstate(over="ignore"):
        z = np.uint64(state) + np.arange(1, count + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z = z ^ (z >> np.uint64(31))
    return (z >> np.uint64(11)).astype(np.float64) / 2.0**52 - 1.0


def tensor(name, shape):
    """Kaiming-like weights, norms near one, small biases, positive variances."""
    x = values(name, int(np.prod(shape)))
    if len(shape) == 4:
        # The compact network's last layers are small, so that its exponential depth stays within a scene's.
        x = x * np.sqrt(6.0 / (shape[1] * shape[2] * shape[3])) * (0.05 if name.endswith("last.weight") and shape[1] < 64 else 1.0)
    elif name.endswith("running_var"):
        x = 1.0 + 0.5 * x
    elif name.endswith(".weight"):
        x = 1.0 + 0.2 * x
    else:
        x = 0.1 * x
    return torch.from_numpy(x.astype(np.float32).reshape(shape))


def fill(module, prefix=""):
    state = module.state_dict()
    module.load_state_dict({k: tensor(prefix + k, v.shape) if v.is_floating_point() else v for k, v in state.items()})
    return module.eval()


def up(x, factor):
    return F.interpolate(x, scale_factor=factor, mode="bilinear", align_corners=False)


class PaperHead(nn.Module):
    def __init__(self, features=512):
        super().__init__()
        self.reduce = nn.Conv2d(features, 256, 1)
        self.conv1, self.norm1 = nn.Conv2d(256, 256, 7, padding=3), nn.LayerNorm(256)
        self.conv2, self.norm2 = nn.Conv2d(256, 128, 7, padding=3), nn.LayerNorm(128)
        self.last = nn.Conv2d(128, 1, 1)

    def forward(self, x):
        x = self.reduce(x)
        for conv, norm in ((self.conv1, self.norm1), (self.conv2, self.norm2)):
            x = F.leaky_relu(norm(conv(x).permute(0, 2, 3, 1)).permute(0, 3, 1, 2), 0.01)
        return self.last(x)


class ConvNorm(nn.Module):
    def __init__(self, cin, cout, kernel, stride=1, groups=1):
        super().__init__()
        self.conv = nn.Conv2d(cin, cout, kernel, stride, kernel // 2, groups=groups, bias=False)
        self.norm = nn.BatchNorm2d(cout)

    def forward(self, x):
        return self.norm(self.conv(x))


class Stage(nn.Module):
    def __init__(self, cin, cout):
        super().__init__()
        self.down = ConvNorm(cin, cout, 3, 2)
        self.block = timm.models.resnet.BasicBlock(cout, cout)

    def forward(self, x):
        return self.block(torch.relu(self.down(x)))


class Compact(nn.Module):
    def __init__(self, stem, stages, pyramid, **_):
        super().__init__()
        self.stem = ConvNorm(3, stem, 5, 2)
        self.stages = nn.ModuleList(Stage(a, b) for a, b in zip([stem, *stages[:-1]], stages))
        self.laterals = nn.ModuleList(nn.Conv2d(c, pyramid, 1) for c in stages)
        self.fuse = ConvNorm(pyramid, pyramid, 3)

    def forward(self, x):
        x, maps = torch.relu(self.stem(x)), []
        for stage, lateral in zip(self.stages, self.laterals):
            x = stage(x)
            maps.append(lateral(x))
        y = maps.pop()
        while maps:
            y = up(y, 2) + maps.pop()
        return torch.relu(self.fuse(y))


class DepthwiseHead(nn.Module):
    def __init__(self, channels):
        super().__init__()
        self.spatial = ConvNorm(channels, channels, 7, groups=channels)
        self.mix = ConvNorm(channels, channels, 1)
        self.last = nn.Conv2d(channels, 1, 1)

    def forward(self, x):
        return self.last(torch.relu(self.mix(torch.relu(self.spatial(x))) + x))


def decoded(heatmap, depth, beta, stride):
    """x, y in px and depth in m."""
    p = torch.softmax((beta * heatmap).double().flatten(), 0).reshape(heatmap.shape)
    centre = lambda n: (torch.arange(n).double() + 0.5) * stride - 0.5
    return torch.stack([(p.sum(0) * centre(p.shape[1])).sum(), (p.sum(1) * centre(p.shape[0])).sum(),
                        (p * depth.double()).sum()]).float()


@torch.no_grad()
def paper():
    resnet = timm.create_model("resnet34", pretrained=False)
    shapes = {k: list(v.shape) for k, v in resnet.state_dict().items()}
    with open(os.path.join(HERE, "timm_resnet34.json"), "w") as out:
        json.dump(shapes, out, indent=0)
    fill(resnet)
    picture = torch.from_numpy(values("picture", 3 * HEIGHT * WIDTH).astype(np.float32).reshape(1, 3, HEIGHT, WIDTH))
    f1 = torch.relu(resnet.bn1(resnet.conv1(picture)))
    f2 = resnet.layer1(resnet.maxpool(f1))
    f3 = resnet.layer2(f2)
    f4 = resnet.layer3(f3)
    features = torch.cat([f1, up(f2, 2), up(f3, 4), up(f4, 8)], 1)
    heatmap = up(fill(PaperHead(), "heatmap_head.")(features), 2)[0, 0]
    depth = up(F.softplus(fill(PaperHead(), "depth_head.")(features), 2, 16), 2)[0, 0]
    return {"heatmap": heatmap, "depth": depth, "decoded": decoded(heatmap, depth, 2.0, 1),
            "decoded_sharp": decoded(heatmap, depth, 10.0, 1)}


@torch.no_grad()
def convnext(name):
    net = timm.create_model(name, pretrained=False)
    with open(os.path.join(HERE, f"timm_{name}.json"), "w") as out:
        json.dump({k: list(v.shape) for k, v in net.state_dict().items()}, out, indent=0)
    fill(net)
    x = net.stem(torch.from_numpy(values("picture", 3 * HEIGHT * WIDTH).astype(np.float32).reshape(1, 3, HEIGHT, WIDTH)))
    maps = []
    for stage in net.stages:
        x = stage(x)
        maps.append(up(x, 2 ** len(maps)) if maps else x)
    features = torch.cat(maps, 1)
    head = lambda name: fill(PaperHead(features.shape[1]), name)(features)
    heatmap, depth = up(head("heatmap_head."), 4)[0, 0], up(F.softplus(head("depth_head."), 2, 16), 4)[0, 0]
    return {"heatmap": heatmap, "depth": depth, "decoded": decoded(heatmap, depth, 2.0, 1)}


@torch.no_grad()
def compact():
    picture = torch.from_numpy(values("picture", 3 * HEIGHT * WIDTH).astype(np.float32).reshape(1, 3, HEIGHT, WIDTH))
    features = fill(Compact(**COMPACT), "backbone.")(picture)
    heatmap = fill(DepthwiseHead(COMPACT["pyramid"]), "heatmap_head.")(features)[0, 0]
    depth = COMPACT["prior_depth"] * torch.exp(fill(DepthwiseHead(COMPACT["pyramid"]), "depth_head.")(features))[0, 0]
    return {"heatmap": heatmap, "depth": depth, "decoded": decoded(heatmap, depth, 1.0, 4)}


if __name__ == "__main__":
    torch.set_num_threads(1)
    for name, golden in (("pen_paper", paper()), ("pen_compact", compact()),
                         ("pen_convnext_nano", convnext("convnext_nano")),
                         ("pen_convnextv2_nano", convnext("convnextv2_nano"))):
        save_file({k: v.contiguous() for k, v in golden.items()}, os.path.join(HERE, f"{name}.safetensors"))
        os.chmod(os.path.join(HERE, f"{name}.safetensors"), 0o644)
        print(name, {k: (list(v.shape), float(v.min()), float(v.max())) for k, v in golden.items()})
