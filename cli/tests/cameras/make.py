"""Makes this folder's files: one camera in the formats of other tools, and where it sees a few points (expected.json).

    pip install numpy opencv-python-headless==5.0.0.93 && python make.py

OpenCV writes its own formats and projects the points; the other formats are written by hand, as their tools do. The points are this
project's: z up, metres, pixels from the first pixel's centre."""

import json
import os

import cv2
import numpy as np

os.chdir(os.path.dirname(os.path.abspath(__file__)))
EYE = np.array([3.0, -8.0, 4.0])
FORWARD = -EYE / np.linalg.norm(EYE)
RIGHT = np.cross(FORWARD, [0, 0, 1.0])
RIGHT /= np.linalg.norm(RIGHT)
R = np.stack([RIGHT, np.cross(FORWARD, RIGHT), FORWARD])
T = -R @ EYE
POINTS = np.array([[0.0, 0, 0], [1.5, 0.5, 0.2], [-2.0, 1.0, 1.0], [0.5, 3.0, 2.0], [-0.5, -2.5, 0.1]])
K = np.array([[1010.0, 0, 641.5], [0, 1005.0, 362.25], [0, 0, 1]])
BROWN = np.array([-0.21, 0.05, 0.001, -0.002, 0.003])
RATIONAL = np.array([0.9, -0.35, 0.0012, -0.0007, 0.04, 1.15, -0.22, 0.015])
FISHEYE = np.array([0.04, -0.012, 0.006, -0.0011])
# This project's axes of the file's.
Z_DOWN = np.diag([1.0, -1, -1])
Y_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])

VECTOR = cv2.Rodrigues(R)[0]


def seen(lens=np.zeros(5), matrix=K):
    return cv2.projectPoints(POINTS, VECTOR, T, matrix, lens)[0].reshape(-1, 2).tolist()


def seen_by_fisheye():
    return cv2.fisheye.projectPoints(POINTS.reshape(-1, 1, 3), VECTOR, T, K, FISHEYE)[0].reshape(-1, 2).tolist()


def by_opencv(name):
    turned = R @ Z_DOWN
    storage = cv2.FileStorage(name, cv2.FILE_STORAGE_WRITE)
    storage.write("calibration_time", "Thu 01 Jan 2026 10:00:00 AM")
    storage.write("image_width", 1280)
    storage.write("image_height", 720)
    storage.write("camera_matrix", K)
    storage.write("distortion_coefficients", BROWN.reshape(1, 5))
    storage.write("rvec", cv2.Rodrigues(turned)[0])
    storage.write("tvec", 1000 * T.reshape(3, 1))
    storage.release()


def by_calibration_sample():
    """As OpenCV 2 to 4 wrote it: that header, and a row of rotation vector and translation a picture."""
    rows = np.hstack([np.ravel(cv2.Rodrigues(R @ Z_DOWN)[0]), 100 * T])
    other = np.hstack([[0.1, 0.2, 0.3], [1.0, 2.0, 300.0]])
    numbers = lambda values: ",\n       ".join(f"{value:.16e}" for value in np.ravel(values))
    matrix = lambda values: (
        f"!!opencv-matrix\n   rows: {values.shape[0]}\n   cols: {values.shape[1]}\n   dt: d\n   data: [ {numbers(values)} ]\n"
    )
    text = "%YAML:1.0\n---\ncalibration_time: \"Thu 01 Jan 2026 10:00:00 AM\"\nnframes: 2\nimage_width: 1280\nimage_height: 720\n"
    text += "board_width: 9\nflags: 16384\nfisheye_model: 0\n"
    text += "camera_matrix: " + matrix(K) + "distortion_coefficients: " + matrix(RATIONAL.reshape(8, 1))
    text += "avg_reprojection_error: 2.5e-01\nextrinsic_parameters: " + matrix(np.stack([other, rows]))
    open("sample.yml", "w").write(text)


def by_ros():
    text = "image_width: 1280\nimage_height: 720\ncamera_name: narrow_stereo\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
    text += f"  data: {np.ravel(K).tolist()}\ndistortion_model: %s\ndistortion_coefficients:\n  rows: 1\n  cols: %d\n  data: %s\n"
    text += "rectification_matrix:\n  rows: 3\n  cols: 3\n  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]\nprojection_matrix:\n  rows: 3\n  cols: 4\n"
    text += "  data: [1010, 0, 641.5, 0, 0, 1005, 362.25, 0, 0, 0, 1, 0]\n"
    for name, model, lens in [
        ("plumb_bob", "plumb_bob", BROWN),
        ("rational", "rational_polynomial", RATIONAL),
        ("equidistant", "equidistant", FISHEYE),
    ]:
        open(f"ros_{name}.yaml", "w").write(text % (model, len(lens), lens.tolist()))


def by_kalibr():
    text = ""
    for name, model, lens in [("cam0", "radtan", BROWN[:4]), ("cam1", "equi", FISHEYE)]:
        text += f"{name}:\n  cam_overlaps: []\n  camera_model: pinhole\n  distortion_coeffs: {lens.tolist()}\n  distortion_model: {model}\n"
        text += "  intrinsics: [1010.0, 1005.0, 641.5, 362.25]\n  resolution: [1280, 720]\n  rostopic: /%s/image_raw\n" % name
    open("camchain.yaml", "w").write(text)


def by_colmap():
    """Pixels from the corner, y up, one COLMAP unit is a metre."""
    turned = R @ Y_UP
    w = np.sqrt(1 + np.trace(turned)) / 2
    x, y, z = [(turned[(i + 2) % 3, (i + 1) % 3] - turned[(i + 1) % 3, (i + 2) % 3]) / (4 * w) for i in range(3)]
    text = "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n# Number of cameras: 4\n"
    text += "1 SIMPLE_RADIAL 1280 720 1010 642 362.75 -0.1\n2 OPENCV 1280 720 1010 1005 642 362.75 -0.21 0.05 0.001 -0.002\n"
    text += "3 FULL_OPENCV 1280 720 1010 1005 642 362.75 " + " ".join(map(str, RATIONAL)) + "\n"
    text += "4 OPENCV_FISHEYE 1280 720 1010 1005 642 362.75 " + " ".join(map(str, FISHEYE)) + "\n5 FOV 1280 720 1010 1005 642 362.75 0.9\n"
    open("colmap/cameras.txt", "w").write(text)
    text = "# Image list with two lines of data per image:\n#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n#   POINTS2D[] as (X, Y, POINT3D_ID)\n"
    pose = " ".join(f"{value:.17g}" for value in [w, x, y, z, *T])
    for index, points in enumerate(["10.5 20.5 -1 30.25 40.5 7", "", "1.5 2.5 3", "", ""], start=1):
        text += f"{index} {pose} {index} view {index}.jpg\n{points}\n"
    open("colmap/images.txt", "w").write(text)


def by_tsai():
    """Tsai's own equations: seen points by Newton's method; millimetres. Attributes of PETS 2009."""
    focal, kappa, sx, dpx, dpy, cx, cy = 5.5549183034, 5.1113043639e-03, 1.0937855397, 5.1273271277e-03, 4.65e-03, 324.22149053, 282.5665005
    ry = -np.arcsin(R[2, 0])
    rx, rz = np.arctan2(R[2, 1], R[2, 2]), np.arctan2(R[1, 0], R[0, 0])
    tx, ty, tz = 1000 * T
    text = f"""<?xml version="1.0" encoding="UTF-8"?>
<Camera name="View_001">
  <Geometry width="768" height="576" ncx="7.9500000000e+02" nfx="7.5200000000e+02" dx="4.8500000000e-03" dy="{dpy}" dpx="{dpx}" dpy="{dpy}"/>
  <Intrinsic focal="{focal}" kappa1="{kappa}" cx="{cx}" cy="{cy}" sx="{sx}"/>
  <Extrinsic tx="{tx:.17g}" ty="{ty:.17g}" tz="{tz:.17g}" rx="{rx:.17g}" ry="{ry:.17g}" rz="{rz:.17g}"/>
</Camera>
"""
    open("tsai.xml", "w").write(text)
    images = []
    for point in POINTS:
        x, y, z = 1000 * (R @ point + T)
        ideal = focal * np.array([x, y]) / z
        radius = r = np.linalg.norm(ideal)
        for _ in range(50):
            r -= (r * (1 + kappa * r * r) - radius) / (1 + 3 * kappa * r * r)
        u, v = ideal * (r / radius if radius > 0 else 1)
        images.append([sx * u / dpx + cx, v / dpy + cy])
    return images


for extension in ["yml", "xml", "json"]:
    by_opencv(f"opencv.{extension}")
by_calibration_sample()
by_ros()
by_kalibr()
by_colmap()
turned = cv2.Rodrigues(R @ Z_DOWN)[0]
np.savez("opencv.npz", mtx=K, dist=BROWN.reshape(1, 5), rvecs=[turned + 0.1, turned], tvecs=[T.reshape(3, 1), T.reshape(3, 1)], names=np.array(["a", "b"]))
simple = np.array([[1010.0, 0, 641.5], [0, 1010.0, 362.25], [0, 0, 1]])
images = {
    "brown": seen(BROWN),
    "radtan": seen(BROWN[:4]),
    "rational": seen(RATIONAL),
    "fisheye": seen_by_fisheye(),
    "simple radial": seen(np.array([-0.1, 0, 0, 0]), simple),
    "tsai": by_tsai(),
}
json.dump({"points": POINTS.tolist(), "images": images}, open("expected.json", "w"), indent=1)
