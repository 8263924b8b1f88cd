"""Makes the folders beside it: tiny data sets in other people's formats, and expected.json, what is in them.

Needs numpy and pillow: python tests/golden/import/make.py
"""

import json
import shutil
from pathlib import Path

import numpy as np
from PIL import Image

HERE = Path(__file__).parent
W, H = 32, 24
rng = np.random.default_rng(7)
expected = {}


def pose(azimuth, elevation, distance):
    """Rows right, down, forward, and the translation, of a camera that looks at the origin."""
    a, e = np.radians([azimuth, elevation])
    forward = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return rotation, -rotation @ (-distance * forward)


def intrinsic(f, w=W, h=H):
    return np.array([[f, 0, (w - 1) / 2], [0, f, (h - 1) / 2], [0, 0, 1.0]])


def project(k, rotation, translation, ball):
    x = k @ (rotation @ ball + translation)
    return x[:2] / x[2]


def picture(path, image=None, w=W, h=H):
    path.parent.mkdir(parents=True, exist_ok=True)
    # few colours keep the files small
    pixels = np.full((h, w, 3), 150, np.uint8)
    pixels[:4, :4] = rng.integers(0, 255, (4, 4, 3))
    if image is not None:
        y, x = np.mgrid[:h, :w]
        pixels[np.hypot(x - image[0], y - image[1]) < 2] = [0, 82, 87]
    Image.fromarray(pixels).save(path)


def matrix(rotation, translation):
    return np.vstack([np.column_stack([rotation, translation]), [0, 0, 0, 1]])


def camera(k, rotation, translation, w=W, h=H):
    return {"width": w, "height": h, "intrinsic": k.tolist(), "camera_from_world": matrix(rotation, translation).tolist()}


def frame(file, t, image=None, world=None):
    image = None if image is None else [float(v) for v in image]
    world = None if world is None else [float(v) for v in world]
    return {"source": str(file.relative_to(HERE)), "t": float(t), "image": image, "world": world}


def write(path, text, newline="\n", encoding="utf-8"):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(text.replace("\n", newline).encode(encoding))


def simulated(folder, id, view, frames, first=0, newline="\n", hidden=(), path=None):
    """A video of the synthetic data set or of the spring."""
    rotation, translation = pose(*view)
    k = intrinsic(28.97)
    left_up_forward = np.diag([-1, -1, 1]) @ np.column_stack([rotation, translation])
    names = "t, camera x, camera y, camera z, ball x, ball y, ball z, ball vx, ball vy, ball vz, ball camx, ball camy, ball camz, ball imgx, ball imgy, ball visible"
    lines, out = [names], []
    centre = -rotation.T @ translation
    for i in range(frames):
        t = i / 15
        ball = np.array([-0.8 + 0.7 * t, 0.5 - 0.3 * t, 1.5 - 0.5 * t * t])
        image = project(k, rotation, translation, ball)
        in_theirs = left_up_forward @ np.append(ball, 1)
        seen = i not in hidden
        numbers = [t, *centre, *ball, 0.7, -0.3, -t, *in_theirs, image[0], H - image[1]]
        lines.append(", ".join(f"{n:.9f}" for n in numbers) + f", {int(seen)}")
        file = folder / f"image-{first + i}.png"
        picture(file, image if seen else None)
        out.append(frame(file, t, image if seen else None, ball))
    write(folder / "label.csv", "\n".join(lines) + "\n", newline)
    theirs = np.diag([-1.0, 1.0, 1.0]) @ np.diag([k[0, 0], k[1, 1], 1])
    theirs[:2, 2] = k[:2, 2]
    rows = lambda m: "\n".join(", ".join(f"{n:.9f}" for n in row) + "," for row in m)
    info = "E\n" + rows(np.vstack([left_up_forward, [0, 0, 0, 1]])) + "\nI \n" + rows(theirs) + "\n"
    write(folder / "info.txt", info, newline)
    expected.setdefault(path, {})[id] = {"fps": 15, "camera": camera(k, rotation, translation), "frames": out}


def synthetic():
    root = HERE / "sd" / "synthetic_dataset"
    simulated(root / "train/xml0/camera0/7", "train/env1/cam1/0007", (40, -60, 8), 6, path="sd")
    simulated(root / "test/xml2/camera8/0", "test/env3/cam9/0000", (60, -50, 8), 5, newline="\r\n", hidden=[2], path="sd")
    simulated(HERE / "spring/ball_carousel/val/3", "val/spring/cam1/0003", (40, -60, 7), 5, first=1, path="spring")


def real():
    """20 frames at 60 a second, two left out after the tenth, one without a label, one without depth."""
    camera1 = HERE / "rd/real_dataset/train/camera1"
    folder = camera1 / "0"
    rotation, translation = pose(200, -25, 2.5)
    k = intrinsic(70.0, 2 * W, 2 * H)
    small = np.diag([0.5, 0.5, 1]) @ k
    small[:2, 2] = (k[:2, 2] + 0.5) / 2 - 0.5
    extrinsic = matrix(rotation, translation)
    folder.mkdir(parents=True)
    np.savez_compressed(camera1 / "matrices.npz", Mint=k, Mext=np.asfortranarray(extrinsic))
    write(folder / "metadata.csv", f"original_height;original_width;resized_height;resized_width;max_depth\n{2 * H};{2 * W};{H};{W};4.0\n")
    labels, stamps, out = ["ball_x;ball_y"], ["timestamp"], []
    start = 1_693_000_000_123_456_789
    for i in range(20):
        step = i + (2 if i >= 10 else 0)
        t = step / 60
        ball = np.array([-0.3 + 0.8 * t, 0.2 - t, 0.6 - 0.5 * t])
        image = project(small, rotation, translation, ball)
        depth = (rotation @ ball + translation)[2]
        file = folder / f"frame{i:04}.png"
        picture(file, image)
        stamps.append(str(start + step * 50_000_000 // 3))
        column, row = np.round(image).astype(int)
        pixels = np.zeros((H, W), np.uint8)
        world = None
        if i != 7:
            grey = int(depth / 4.0 * 255)
            pixels[row, column], pixels[row, column + 1] = grey, grey + 1
            # outside the window, and nearer
            pixels[row, column - 3] = 9
            z = (grey + 0.5) / 255 * 4.0
            world = rotation.T @ (np.linalg.inv(small) @ np.append(image, 1) * z - translation)
        Image.fromarray(pixels).save(folder / f"depth{i:04}.png")
        # some write numbers with a comma
        labels.append(";" if i == 12 else f"{image[0]:.9f};{image[1]:.9f}".replace(".", "," if i == 3 else "."))
        seen = i != 12
        out.append(frame(file, (step * 50_000_000 // 3) * 1e-9, image if seen else None, world if seen else None))
    write(folder / "labels.csv", "\n".join(labels) + "\n")
    write(folder / "timestamps.csv", "\n".join(stamps) + "\n")
    cam = camera(small, rotation, translation)
    for part, frames in enumerate([out[:16], out[16:]]):
        expected.setdefault("rd", {})[f"train/real/cam1/0000/{part:02}"] = {"fps": 60, "camera": cam, "frames": frames}


def own_camera():
    rotation, translation = pose(30, -40, 5)
    k = intrinsic(30.0)
    write(HERE / "camera.json", json.dumps(camera(k, rotation, translation), indent=1) + "\n")
    return camera(k, rotation, translation)


def coco(cam):
    images, annotations, folders = [], [], {"a": [], "b": []}
    for group, numbers in [("a", [1, 2, 4, 10]), ("b", [0, 1])]:
        for i, number in enumerate(numbers):
            name = f"{group}/shot{number}.{'jpg' if number == 2 else 'png'}"
            image = np.array([5.25 + 2 * i, 7.5 + i])
            file = HERE / "coco/images" / name
            picture(file, image)
            id = len(images) + 1
            images.append({"id": id, "file_name": name, "width": W, "height": H, "license": 1})
            label = None
            if group == "a":
                # the first keypoint is hidden in one picture
                points = [1.0, 1.0, 1 if i == 1 else 0, *image, 2, 30.0, 20.0, 2]
                annotations.append({"id": id, "image_id": id, "category_id": 3, "keypoints": points, "num_keypoints": 2})
                label = image
            elif i == 0:
                corner = image + 0.5 - [2, 1.5]
                annotations.append({"id": id, "image_id": id, "category_id": 3, "bbox": [*corner, 4, 3], "iscrowd": 0})
                label = image
            if group == "a":
                annotations.append({"id": 100 + id, "image_id": id, "category_id": 5, "bbox": [0, 0, 9, 9]})
            folders[group].append(frame(file, (number - numbers[0]) / 25, label))
    # the order in the file is not that of time
    images.reverse()
    categories = [{"id": 3, "name": "ball"}, {"id": 5, "name": "racket"}]
    text = json.dumps({"info": {"year": 2024}, "images": images, "annotations": annotations, "categories": categories}, indent=1)
    write(HERE / "coco/instances.json", text + "\n")
    expected["coco"] = {group: {"fps": 25, "camera": cam, "frames": frames} for group, frames in folders.items()}


def cvat(cam):
    lines, out = ['<?xml version="1.0" encoding="utf-8"?>', "<annotations>", "  <version>1.1</version>"], []
    for i in range(4):
        image = np.array([4.0 + 3 * i, 10.25])
        file = HERE / f"cvat/images/shots/{i:03}.webp"
        picture(file, image)
        lines.append(f'  <image id="{i}" name="shots/{i:03}.webp" width="{W}" height="{H}">')
        x, y = image + 0.5
        if i == 1:
            lines.append(f'    <box label="ball" occluded="0" xtl="{x - 2}" ytl="{y - 1}" xbr="{x + 2}" ybr="{y + 1}" z_order="0"></box>')
        elif i != 2:
            lines.append(f'    <points label="ball" occluded="0" points="{x},{y};0,0" z_order="0"></points>')
        lines.append('    <polygon label="table" points="0,0;1,1;2,0"></polygon>')
        lines.append("  </image>")
        out.append(frame(file, i / 50, None if i == 2 else image))
    write(HERE / "cvat/images.xml", "\n".join([*lines, "</annotations>"]) + "\n")
    expected["cvat_images"] = {"shots": {"fps": 50, "camera": cam, "frames": out}}

    size = f"<original_size><width>{W}</width><height>{H}</height></original_size>"
    lines = ["<annotations>", f"  <meta><task>{size}</task></meta>", '  <track id="0" label="ball" source="manual">']
    out = []
    for i in range(8):
        image = np.array([4.0 + 3 * i, 12.75])
        file = HERE / f"cvat/rally/frame_{i:06}.png"
        picture(file, image)
        x, y = image + 0.5
        if 1 <= i <= 6:
            lines.append(
                f'    <box frame="{i}" keyframe="1" outside="{int(i == 4)}" occluded="0" '
                f'xtl="{x - 1.5}" ytl="{y - 1.5}" xbr="{x + 1.5}" ybr="{y + 1.5}" z_order="0"></box>'
            )
            out.append(frame(file, (i - 1) / 50, None if i == 4 else image))
    lines += ["  </track>", '  <track id="1" label="player"><box frame="2" outside="0" xtl="0" ytl="0" xbr="9" ybr="9"/></track>']
    write(HERE / "cvat/rally.xml", "\n".join([*lines, "</annotations>"]) + "\n")
    expected["cvat_video"] = {"rally": {"fps": 50, "camera": cam, "frames": out}}


def tracknet(cam):
    for name, separator, newline, bom in [("rally", ",", "\n", ""), ("match/1_02", ";", "\r\n", "\ufeff")]:
        lines, out = [separator.join(["Frame", "Visibility", "X", "Y"])], []
        for i in range(6):
            image = np.array([3.0 + 4 * i, 15.5 - i])
            file = HERE / f"tracknet/{name}/{i}.png"
            picture(file, image)
            # frame 4 is left out, frame 2 hidden, 0 before the first ball
            if i == 4:
                out.append(frame(file, 3 / 30))
            elif i in (0, 2):
                lines.append(separator.join([str(i), "0", "0", "0"]))
                if i == 2:
                    out.append(frame(file, 1 / 30))
            else:
                lines.append(separator.join([str(i), "1", str(image[0]), str(image[1])]))
                out.append(frame(file, (i - 1) / 30, image))
        suffix = "_ball" if separator == "," else ""
        write(HERE / f"tracknet/{name}{suffix}.csv", bom + "\n".join(lines) + "\n", newline)
        expected.setdefault("tracknet", {})[name + suffix] = {"fps": 30, "camera": cam, "frames": out}


def yolo(cam):
    """As Ultralytics writes it: several classes, a picture without a ball, one without labels, a confidence."""
    out = []
    for i in range(5):
        image = np.array([6.0 + 4 * i, 9.5])
        file = HERE / f"yolo/images/train/rally_{i:03}.png"
        picture(file, image)
        cx, cy = (image + 0.5) / [W, H]
        lines = ["0 0.5 0.5 0.25 0.5"]
        if i not in (1, 2, 3):
            lines.append(f"1 {cx:.9f} {cy:.9f} {4 / W:.9f} {3 / H:.9f}" + (" 0.87" if i == 4 else ""))
        if i == 2:
            lines.append("1 0 0 0 0")
        if i != 3:
            write(HERE / f"yolo/labels/train/rally_{i:03}.txt", "\n".join(lines) + "\n")
        out.append(frame(file, i / 50, None if i in (1, 2, 3) else image))
    data = "# one class more than needed\npath: ../yolo\ntrain: images/train\nval: images/train\n\nnames:\n  0: person\n  1: ball\n"
    write(HERE / "yolo/data.yaml", data)
    expected["yolo"] = {"train": {"fps": 50, "camera": cam, "frames": out}}


def labelme(cam):
    """As LabelMe 5 writes it, a file a picture."""
    out = []
    for i in range(5):
        image = np.array([5.0 + 3 * i, 8.25])
        file = HERE / f"labelme/throw/{i + 1}.png"
        picture(file, image)
        x, y = (image + 0.5).tolist()
        kind, points = [
            ("circle", [[x, y], [x + 1.5, y + 2.0]]),
            ("rectangle", [[x + 2, y - 2], [x - 2, y + 2]]),
            ("polygon", [[x - 2, y], [x, y - 1], [x + 2, y], [x, y + 1]]),
            ("point", [[0.0, 0.0]]),
            ("point", [[x, y]]),
        ][i]
        shape = lambda label, kind, points: {
            "label": label, "points": points, "group_id": None, "description": "", "shape_type": kind, "flags": {}, "mask": None
        }
        shapes = [shape("ball", kind, points), shape("net", "line", [[0, 0], [9, 9]])]
        path = file.name if i else "..\\throw\\" + file.name
        text = {"version": "5.5.0", "flags": {}, "shapes": shapes, "imagePath": path, "imageData": None, "imageHeight": H, "imageWidth": W}
        write(HERE / f"labelme/throw/{i + 1}.json", json.dumps(text, indent=2))
        out.append(frame(file, i / 50, None if i == 3 else image))
    # not LabelMe's
    write(HERE / "labelme/camera.json", json.dumps(cam) + "\n")
    expected["labelme"] = {"throw": {"fps": 50, "camera": cam, "frames": out}}


def label_studio(cam):
    """As Label Studio 1.13 exports it (JSON): uploads, whose names begin with eight digits, and a file of the server's disk."""
    tasks, out = [], []
    for i in range(5):
        image = np.array([7.0 + 3 * i, 11.0])
        file = HERE / f"label_studio/images/serve {i}.png"
        picture(file, image)
        x, y = ((image + 0.5) / [W, H] * 100).tolist()
        w, h = 4 / W * 100, 3 / H * 100
        turned = np.radians(90.0)
        corner = (image + 0.5 - [2 * np.cos(turned) - 1.5 * np.sin(turned), 2 * np.sin(turned) + 1.5 * np.cos(turned)]) / [W, H] * 100
        kind, value = [
            ("keypointlabels", {"x": x, "y": y, "width": 0.4}),
            ("rectanglelabels", {"x": x - w / 2, "y": y - h / 2, "width": w, "height": h, "rotation": 0}),
            ("rectanglelabels", {"x": float(corner[0]), "y": float(corner[1]), "width": w, "height": h, "rotation": 90.0}),
            ("ellipselabels", {"x": x, "y": y, "radiusX": w / 2, "radiusY": h / 2, "rotation": 0}),
            (None, None),
        ][i]
        region = {"original_width": W, "original_height": H, "image_rotation": 0, "value": value and {**value, kind: ["ball"]},
                  "id": f"r{i}", "from_name": "label", "to_name": "image", "type": kind, "origin": "manual"}
        said = {"value": {"choices": ["outdoors"]}, "id": "c", "from_name": "where", "to_name": "image", "type": "choices", "origin": "manual"}
        done = {"id": i, "completed_by": 1, "result": [said] + ([region] if kind else []), "was_cancelled": False, "ground_truth": False,
                "lead_time": 3.2, "result_count": 0, "unique_id": "0d5c1c7e", "task": i, "project": 4}
        skipped = {**done, "result": [], "was_cancelled": True}
        where = f"/data/local-files/?d=serve%20{i}.png" if i == 4 else f"/data/upload/4/3f2a90c{i}-serve%20{i}.png"
        tasks.append({"id": 20 + i, "annotations": [skipped, done], "file_upload": f"3f2a90c{i}-serve {i}.png", "drafts": [],
                      "predictions": [], "data": {"image": where, "note": "first set"}, "meta": {}, "inner_id": i + 1, "project": 4})
        out.append((file, None if kind is None else image))
    # the newest comes first in some exports
    write(HERE / "label_studio/project-4.json", json.dumps(tasks[::-1]) + "\n")
    frames = [frame(file, i / 50, image) for i, (file, image) in enumerate(out)]
    expected["label_studio"] = {"project-4": {"fps": 50, "camera": cam, "frames": frames}}


def label_studio_video(cam):
    """A rectangle's key frames, from 1: 1 to 3 on a straight line, then away, then 6."""
    out = []
    for i in range(6):
        image = np.array([6.0 + 3 * i, 12.0])
        file = HERE / f"label_studio_video/clip/{i:04}.png"
        picture(file, image)
        out.append(frame(file, i / 50, None if i in (3, 4) else image))
    key = lambda i, enabled: {"frame": i + 1, "enabled": enabled, "rotation": 0, "x": (4.5 + 3 * i) / W * 100, "y": 11 / H * 100,
                              "width": 4 / W * 100, "height": 3 / H * 100, "time": (i + 1) / 50}
    value = {"framesCount": 6, "duration": 0.12, "sequence": [key(0, True), key(2, False), key(5, False)], "labels": ["ball"]}
    region = {"value": value, "id": "v", "from_name": "box", "to_name": "video", "type": "videorectangle", "origin": "manual"}
    task = {"id": 7, "annotations": [{"id": 1, "result": [region], "was_cancelled": False, "ground_truth": False}],
            "data": {"video": "/data/upload/5/1b2c3d4e-rally.mp4"}, "predictions": [], "drafts": []}
    write(HERE / "label_studio_video/clip.json", json.dumps([task]) + "\n")
    expected["label_studio_video"] = {"rally": {"fps": 50, "camera": cam, "frames": out}}


for folder in ["sd", "spring", "rd", "coco", "cvat", "tracknet", "yolo", "labelme", "label_studio", "label_studio_video"]:
    shutil.rmtree(HERE / folder, ignore_errors=True)
synthetic()
real()
cam = own_camera()
coco(cam)
cvat(cam)
tracknet(cam)
yolo(cam)
labelme(cam)
label_studio(cam)
label_studio_video(cam)
write(HERE / "expected.json", json.dumps(expected, indent=1) + "\n")
