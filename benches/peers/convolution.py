"""PEN in PyTorch and ONNX Runtime, for benches/convolution.rs.

A server: one JSON object a line on standard input, one on standard output.
{"load": {"net", "weights" (safetensors, our names), "threads", "batch"}} -> {"difference": largest difference of
either peer's maps from `expected`, as a share of the largest}; {"run": "torch" | "onnxruntime" | "step", ...} -> {"seconds"}.
"""
import contextlib
import io
import json
import sys
import time
import warnings

import numpy as np
import onnxruntime
import torch
from safetensors.torch import load_file
from torch import nn
from torch.nn import functional as F

warnings.filterwarnings("ignore")


def up(x, factor):
    return F.interpolate(x, scale_factor=factor, mode="bilinear", align_corners=False)


class BasicBlock(nn.Module):
    def __init__(self, cin, cout, stride=1):
        super().__init__()
        self.conv1, self.bn1 = nn.Conv2d(cin, cout, 3, stride, 1, bias=False), nn.BatchNorm2d(cout)
        self.conv2, self.bn2 = nn.Conv2d(cout, cout, 3, 1, 1, bias=False), nn.BatchNorm2d(cout)
        self.downsample = None
        if stride != 1 or cin != cout:
            self.downsample = nn.Sequential(nn.Conv2d(cin, cout, 1, stride, bias=False), nn.BatchNorm2d(cout))

    def forward(self, x):
        skip = x if self.downsample is None else self.downsample(x)
        return torch.relu(self.bn2(self.conv2(torch.relu(self.bn1(self.conv1(x))))) + skip)


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
        self.down, self.block = ConvNorm(cin, cout, 3, 2), BasicBlock(cout, cout)

    def forward(self, x):
        return self.block(torch.relu(self.down(x)))


class CompactBackbone(nn.Module):
    def __init__(self, stem, stages, pyramid):
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
        self.mix, self.last = ConvNorm(channels, channels, 1), nn.Conv2d(channels, 1, 1)

    def forward(self, x):
        return self.last(torch.relu(self.mix(torch.relu(self.spatial(x))) + x))


class ResNet34(nn.Module):
    def __init__(self, width):
        super().__init__()
        self.conv1, self.bn1 = nn.Conv2d(3, width, 7, 2, 3, bias=False), nn.BatchNorm2d(width)

        def layer(count, cin, cout, stride):
            blocks = [BasicBlock(cin if i == 0 else cout, cout, stride if i == 0 else 1) for i in range(count)]
            return nn.Sequential(*blocks)

        self.layer1 = layer(3, width, width, 1)
        self.layer2 = layer(4, width, 2 * width, 2)
        self.layer3 = layer(6, 2 * width, 4 * width, 2)

    def forward(self, x):
        f1 = torch.relu(self.bn1(self.conv1(x)))
        f2 = self.layer1(F.max_pool2d(f1, 3, 2, 1))
        f3 = self.layer2(f2)
        return torch.cat([f1, up(f2, 2), up(f3, 4), up(self.layer3(f3), 8)], 1)


class PaperHead(nn.Module):
    def __init__(self, features, a, b, c):
        super().__init__()
        self.reduce = nn.Conv2d(features, a, 1)
        self.conv1, self.norm1 = nn.Conv2d(a, b, 7, padding=3), nn.LayerNorm(b)
        self.conv2, self.norm2 = nn.Conv2d(b, c, 7, padding=3), nn.LayerNorm(c)
        self.last = nn.Conv2d(c, 1, 1)

    def forward(self, x):
        x = self.reduce(x)
        for conv, norm in ((self.conv1, self.norm1), (self.conv2, self.norm2)):
            x = F.leaky_relu(norm(conv(x).permute(0, 2, 3, 1)).permute(0, 3, 1, 2), 0.01)
        return self.last(x)


class Pen(nn.Module):
    def __init__(self, config):
        super().__init__()
        backbone, head, self.depth = config["backbone"], config["head"], config["depth"]
        if backbone["kind"] == "resnet34":
            self.backbone, features = ResNet34(backbone["width"]), 8 * backbone["width"]
        else:
            self.backbone = CompactBackbone(backbone["stem"], backbone["stages"], backbone["pyramid"])
            features = backbone["pyramid"]
        self.paper = head["kind"] == "paper"
        make = (lambda: PaperHead(features, *head["channels"])) if self.paper else (lambda: DepthwiseHead(features))
        self.heatmap_head, self.depth_head = make(), make()

    def forward(self, x):
        features = self.backbone(x)
        heatmap, depth = self.heatmap_head(features), self.depth_head(features)
        depth = torch.exp(depth) if self.depth["activation"] == "exp" else F.softplus(depth, 2, 16)
        depth = depth * self.depth["scale"]
        return (up(heatmap, 2), up(depth, 2)) if self.paper else (heatmap, depth)


def trainer(net, job):
    """The training step of src/train/step.rs: cross-entropy heatmap loss, smooth L1 depth loss, clip, Adam."""
    net.train()
    optimiser = torch.optim.Adam(net.parameters(), 1e-3)
    share = torch.from_numpy(np.asarray(job["share"], np.float32)).reshape(job["batch"], -1)
    depth = torch.from_numpy(np.asarray(job["depth"], np.float32))

    def step(x):
        optimiser.zero_grad()
        heatmap, found = net(x)
        loss = -(share * F.log_softmax(heatmap.flatten(1), 1)).sum(1).mean()
        loss = loss + 0.2 * F.smooth_l1_loss((found.flatten(1) * share).sum(1), depth, beta=0.5)
        loss.backward()
        nn.utils.clip_grad_norm_(net.parameters(), 1.0)
        optimiser.step()

    return step


peers = {}
for line in sys.stdin:
    job = json.loads(line)
    if "run" in job:
        begin = time.perf_counter()
        peers[job["run"]]()
        print(json.dumps({"seconds": time.perf_counter() - begin}), flush=True)
        continue
    job = job["load"]
    torch.set_num_threads(job["threads"])
    net = Pen(job["config"])
    net.load_state_dict(load_file(job["weights"]), strict=False)
    net.eval()
    picture = np.fromfile(job["picture"], np.float32).reshape(job["batch"], *job["size"], 3)
    x = torch.from_numpy(picture).permute(0, 3, 1, 2)
    last, plain = x.contiguous(memory_format=torch.channels_last), x.contiguous()
    answer = {}
    peers = {}
    if "share" in job:
        step = trainer(net.to(memory_format=torch.channels_last), job)
        peers["PyTorch"] = lambda: step(last)
    else:
        buffer = io.BytesIO()
        with contextlib.redirect_stdout(sys.stderr), torch.no_grad():
            torch.onnx.export(net, (plain,), buffer, dynamo=False, input_names=["x"])
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads, options.inter_op_num_threads = job["threads"], 1
        session = onnxruntime.InferenceSession(buffer.getvalue(), options, providers=["CPUExecutionProvider"])
        feed = {"x": plain.numpy()}
        fast = Pen(job["config"]).eval()
        fast.load_state_dict(net.state_dict())
        fast = fast.to(memory_format=torch.channels_last)

        def run(which, pictures):
            with torch.no_grad():
                return which(pictures)

        peers["PyTorch"] = lambda net=net, x=plain: run(net, x)
        peers["PyTorch, channels last"] = lambda net=fast, x=last: run(net, x)
        peers["ONNX Runtime"] = lambda session=session, feed=feed: session.run(None, feed)
        expected = np.fromfile(job["expected"], np.float32)
        found = [np.concatenate([np.asarray(m).ravel() for m in peers[p]()]) for p in ("PyTorch", "ONNX Runtime")]
        answer["difference"] = float(max(np.abs(f - expected).max() for f in found) / np.abs(expected).max())
        if job.get("onnx"):
            with open(job["onnx"], "wb") as out:
                out.write(buffer.getvalue())
    answer["peers"] = list(peers)
    for _ in range(3 if job["batch"] * job["size"][0] < 4000 and job["config"]["backbone"]["kind"] == "compact" else 1):
        for peer in peers.values():
            peer()
    print(json.dumps(answer), flush=True)
