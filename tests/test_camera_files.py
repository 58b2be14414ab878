"""Cameras of every program: the same camera from each of their files, projects as they lie on disk, and what can be wrong."""

from __future__ import annotations

import json
import struct
import warnings

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from intaglio import Camera, FileError, InputError, IntaglioError, IntaglioWarning, read_photographs, write_image
from intaglio.scenes.photographs import camera_towards

TURN = camera_towards(np.zeros(3), np.array([0.3, 0.4, 1]), np.array([0, 1.0, 0]), 5, focal=80, size=(48, 64)).R
SHIFT = np.array([0.1, -0.2, 5])
CENTER = -TURN.T @ SHIFT
FLIP = np.diag([1.0, -1, -1])
# A lens in the places of the model "brown": k1 k2 k3 k4 p1 p2.
LENS = np.array([-0.08, 0.03, -0.01, 0.0, 0.004, -0.003])
POINTS = np.random.default_rng(5).uniform(-1, 1, (40, 3))


def camera(fx=80.0, fy=80.0, cx=30.5, cy=24.25, lens=LENS, model="brown"):
    return Camera(K=[[fx, 0, cx], [0, fy, cy], [0, 0, 1]], R=TURN, t=SHIFT, size=(48, 64), distortion=lens, model=model)


@pytest.fixture
def folder(tmp_path):
    rng = np.random.default_rng(5)
    for name in ("a.png", "b.png"):
        write_image(rng.random((48, 64, 3)), tmp_path / name)
    return tmp_path


def transform(turn=TURN, center=CENTER):
    """Return the matrix from a camera of OpenGL to the world."""
    whole = np.eye(4)
    whole[:3, :3], whole[:3, 3] = turn.T @ FLIP, center
    return whole


def nerfstudio(folder):
    frame = {"file_path": "./a.png", "transform_matrix": transform().tolist(), "colmap_im_id": 1}
    k1, k2, k3, k4, p1, p2 = LENS
    data = {"w": 64, "h": 48, "fl_x": 80.0, "fl_y": 80.0, "cx": 31.0, "cy": 24.75, "camera_model": "OPENCV", "frames": [frame]}
    (folder / "transforms.json").write_text(json.dumps({**data, "k1": k1, "k2": k2, "k3": k3, "k4": k4, "p1": p1, "p2": p2}))
    return "transforms.json", camera()


def instant_ngp(folder):
    """Intrinsics by the angle of view, names without suffix, as NeRF's synthetic scenes have them."""
    frame = {"file_path": "./a", "transform_matrix": transform().tolist()}
    (folder / "transforms.json").write_text(json.dumps({"camera_angle_x": 2 * np.arctan(0.4), "frames": [frame]}))
    return "transforms.json", camera(cx=31.5, cy=23.5, lens=[])


def nerf_fisheye(folder):
    frame = {"file_path": "a.png", "transform_matrix": transform().tolist(), "fl_x": 80, "fl_y": 81, "cx": 31.0, "cy": 24.75}
    lens = {"k1": 0.02, "k2": -0.01, "k3": 0.003, "k4": -0.001}
    data = {"camera_model": "OPENCV_FISHEYE", "frames": [{**frame, "w": 64, "h": 48, **lens}]}
    (folder / "transforms.json").write_text(json.dumps(data))
    return "transforms.json", camera(fy=81, lens=list(lens.values()), model="fisheye")


def splatting(folder):
    view = {"id": 0, "img_name": "a", "width": 64, "height": 48, "fx": 80, "fy": 81}
    (folder / "cameras.json").write_text(json.dumps([{**view, "position": CENTER.tolist(), "rotation": TURN.T.tolist()}]))
    return "cameras.json", camera(fy=81, cx=31.5, cy=23.5, lens=[])


def openmvg(folder, kind="pinhole_brown_t2", key="disto_t2", lens=(-0.08, 0.03, -0.01, 0.004, -0.003), nested=False):
    first = 1 << 31
    inner = {"width": 64, "height": 48, "focal_length": 80.0, "principal_point": [30.5, 24.25]}
    inner = {"value0": inner} if nested else inner
    intrinsic = {"ptr_wrapper": {"id": first + 1, "data": {**inner, key: list(lens)}}}
    # The second intrinsic's type is told by the first's number.
    kinds = [{"polymorphic_id": first + 1, "polymorphic_name": kind}, {"polymorphic_id": 1}]
    views = []
    for number, name in enumerate(("a.png", "b.png", "unregistered.png")):
        data = {"local_path": "", "filename": name, "width": 64, "height": 48, "id_view": number, "id_intrinsic": number % 2}
        pointer = {"polymorphic_id": 1 << 30, "ptr_wrapper": {"id": first + 2, "data": {**data, "id_pose": number}}}
        views.append({"key": number, "value": pointer})
    pose = {"rotation": TURN.tolist(), "center": CENTER.tolist()}
    data = {
        "sfm_data_version": "0.3",
        "root_path": str(folder),
        "views": views,
        "intrinsics": [{"key": k, "value": {**kinds[k], **intrinsic}} for k in (0, 1)],
        "extrinsics": [{"key": k, "value": pose} for k in (0, 1)],
        "structure": [],
        "control_points": [],
    }
    (folder / "sfm_data.json").write_text(json.dumps(data))
    return "sfm_data.json", camera()


def openmvg_nested(folder):
    return openmvg(folder, "pinhole_radial_k3", "disto_k3", LENS[:3], nested=True)[0], camera(lens=LENS[:3])


def openmvg_fisheye(folder):
    lens = [0.02, -0.01, 0.003, -0.001]
    return openmvg(folder, "fisheye", "fisheye", lens)[0], camera(lens=lens, model="fisheye")


def meshroom(folder, version=(1, 2, 8), **intrinsic):
    """The intrinsics are those of AliceVision's own scenes for its versions, at this size."""
    center = [30.5, 24.25] if version < (1, 2, 1) else [30.5 - 32, 24.25 - 24]
    common = {"intrinsicId": "7", "width": "64", "height": "48", "serialNumber": "", "initializationMode": "none"}
    common |= {"principalPoint": list(map(str, center)), "locked": "0", **intrinsic}
    view = {"viewId": "1", "poseId": "9", "intrinsicId": "7", "path": "D:\\photos\\a.png", "width": "64", "height": "48"}
    # Column by column, as Eigen keeps matrices.
    pose = {"rotation": list(map(str, TURN.T.reshape(-1))), "center": list(map(str, CENTER))}
    data = {
        "version": list(map(str, version)),
        "views": [{**view, "metadata": ""}, {**view, "viewId": "2", "poseId": "2", "path": "b.png"}],
        "intrinsics": [common],
        "poses": [{"poseId": "9", "pose": {"transform": pose, "locked": "0"}}],
    }
    (folder / "cameras.sfm").write_text(json.dumps(data))
    return "cameras.sfm", camera(fx=40, fy=80)


def meshroom_old(folder):
    terms = [str(v) for v in (*LENS[:3], *LENS[4:])]
    name, _ = meshroom(folder, (1, 0, 0), type="brown", pxFocalLength="80", pxInitialFocalLength="80", distortionParams=terms)
    return name, camera()


def meshroom_two_focals(folder):
    terms = [str(v) for v in LENS[:3]]
    name, _ = meshroom(folder, (1, 2, 0), type="radial3", pxFocalLength=["40", "80"], distortionParams=terms)
    return name, camera(fx=40, lens=LENS[:3])


def meshroom_millimetres(folder):
    options = {"type": "pinhole", "sensorWidth": "36", "focalLength": str(40 * 36 / 64), "pixelRatio": "2"}
    name, _ = meshroom(folder, (1, 2, 8), **options, distortionType="none", distortionParams="")
    return name, camera(fx=40, lens=[])


def meshroom_newest(folder):
    options = {"type": "pinhole", "sensorWidth": "36", "focalLength": str(80 * 36 / 64), "pixelRatio": "2"}
    name, _ = meshroom(folder, (1, 2, 14), **options, distortionType="radialk3", distortionParams=[str(v) for v in LENS[:3]])
    return name, camera(fx=40, lens=LENS[:3])


def meshroom_fisheye1(folder):
    name, _ = meshroom(folder, (1, 1, 0), type="fisheye1", pxFocalLength="80", distortionParams=["0.7"])
    (folder / name).write_text((folder / name).read_text().replace('"principalPoint": ["-1.5", "0.25"]', '"?": 0'))
    return name, camera(lens=[0.7], model="fov")


METASHAPE = """<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0">
  <chunk label="Chunk 1" enabled="true">
    <sensors next_id="1">
      <sensor id="0" label="lens" type="{kind}">
        <resolution width="64" height="48"/>
        <property name="focal_length" value="12.28999999"/>
        <calibration type="{kind}" class="initial"><resolution width="64" height="48"/><f>1</f></calibration>
        <calibration type="{kind}" class="adjusted">
          <resolution width="64" height="48"/>{calibration}
        </calibration>
        <covariance><params>f cx</params><coeffs>1 0 0 1</coeffs></covariance>
      </sensor>
    </sensors>
    <components next_id="1" active_id="0">
      <component id="0" label="Component 1"><transform>
          <rotation locked="true">{rotation}</rotation>
          <translation locked="true">{translation}</translation>
          <scale locked="true">2.5</scale>
      </transform></component>
    </components>
    <cameras next_id="4" next_group_id="0">
      <camera id="0" sensor_id="0" component_id="0" label="a"><transform>{transform}</transform></camera>
      <camera id="1" sensor_id="0" component_id="0" label="b.png" enabled="0"><transform>{transform}</transform></camera>
      <group id="0" label="Group 1" type="folder">
        <camera id="2" sensor_id="0" component_id="0" label="c.png"><orientation>1</orientation></camera>
      </group>
    </cameras>
  </chunk>
</document>
"""


def metashape(folder, kind="frame", calibration=None):
    turn, shift = Rotation.from_euler("xyz", [0.3, -0.5, 1.1]).as_matrix(), np.array([3.0, -1.0, 2.0])
    inner = np.eye(4)
    inner[:3, :3], inner[:3, 3] = turn.T @ TURN.T, turn.T @ (CENTER - shift) / 2.5
    k1, k2, k3, _, p1, p2 = LENS
    calibration = calibration or (
        f"<f>80</f><cx>-1</cx><cy>0.75</cy><b1>2</b1><b2>0.5</b2><k1>{k1}</k1><k2>{k2}</k2><k3>{k3}</k3><p1>{p2}</p1><p2>{p1}</p2>"
    )

    def words(values):
        return " ".join(map(repr, map(float, np.ravel(values))))

    text = METASHAPE.format(
        kind=kind, calibration=calibration, rotation=words(turn), translation=words(shift), transform=words(inner)
    )
    (folder / "cameras.xml").write_text(text)
    k = [[82, 0.5, 30.5], [0, 80, 24.25], [0, 0, 1]]
    return "cameras.xml", Camera(K=k, R=TURN, t=SHIFT, distortion=LENS, model="brown")


def metashape_fisheye(folder):
    name, _ = metashape(folder, "fisheye", "<f>80</f><cx>-1</cx><cy>0.75</cy><k1>0.02</k1><k4>-0.01</k4>")
    return name, camera(lens=[0.02, 0, 0, -0.01], model="fisheye")


def metashape_old(folder):
    name, _ = metashape(
        folder, "frame", "<fx>80</fx><fy>81</fy><cx>31</cx><cy>24.75</cy><p1>0.004</p1><p2>-0.003</p2><skew>0</skew>"
    )
    return name, camera(fy=81, lens=[0, 0, 0, 0, 0.004, -0.003])


def angles():
    """Return RealityCapture's yaw, pitch and roll of the camera: of the rotation from OpenGL's camera to the world."""
    yaw, pitch, roll = Rotation.from_matrix(TURN.T @ FLIP).as_euler("ZXY", degrees=True)
    return -yaw, pitch, roll


def realitycapture(folder, header="#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2"):
    k1, k2, k3, k4, p1, p2 = LENS
    row = ["a.png", *CENTER, *angles(), 80 * 36 / 64, -1 / 64, 0.75 / 64, k1, k2, k3, k4, p2, p1]
    (folder / "registration.csv").write_text(f"#cameras 1\n{header}\n{','.join(map(str, row))}\n")
    return "registration.csv", camera()


def realityscan(folder):
    return realitycapture(folder, "#name,x,y,alt,yaw,pitch,roll,f_35mm,px_norm,py_norm,k1,k2,k3,k4,t1,t2")


XMP = """<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
  <rdf:Description xcr:Version="3" xcr:PosePrior="exact" xcr:Coordinates="absolute" xcr:DistortionModel="brown3t2"
     xcr:FocalLength35mm="{f}" xcr:Skew="0" xcr:AspectRatio="1" xcr:PrincipalPointU="{u}" xcr:PrincipalPointV="{v}"
     xmlns:xcr="http://www.capturingreality.com/ns/xcr/1.1#">
   <xcr:Rotation>{rotation}</xcr:Rotation><xcr:Position>{position}</xcr:Position>
   <xcr:DistortionCoeficients>{lens}</xcr:DistortionCoeficients></rdf:Description></rdf:RDF></x:xmpmeta>
"""


def realitycapture_xmp(folder):
    k1, k2, k3, k4, p1, p2 = LENS
    text = XMP.format(
        f=45, u=-1 / 64, v=0.75 / 64, lens=f"{k1} {k2} {k3} {k4} {p2} {p1}",
        rotation=" ".join(map(str, TURN.reshape(-1))), position=" ".join(map(str, CENTER)),
    )  # fmt: skip
    (folder / "a.xmp").write_text(text)
    return ".", camera()


def visualsfm(folder, fixed=""):
    x, y, z, w = Rotation.from_matrix(TURN).as_quat()
    (folder / "v.nvm").write_text(f"NVM_V3 {fixed}\n\n1\na.png 80 {w} {x} {y} {z} {' '.join(map(str, CENTER))} -0.05 0\n")
    return "v.nvm", camera(cx=31.5, cy=23.5, lens=[-0.05], model="inverse")


def visualsfm_fixed(folder):
    return visualsfm(folder, "FixedK 80 31 81 24.75 -0.05")[0], camera(fy=81, lens=[-0.05], model="inverse")


def bundler_of_others(folder):
    """RealityCapture's list has another name, and names may have spaces."""
    bundler(folder)
    (folder / "a.png").rename(folder / "a b.png")
    (folder / "list.txt").unlink()
    (folder / "imagelist.lst").write_text("D:\\shots\\a b.png\nb.png\n")
    return "bundle.out", camera(cx=31.5, cy=23.5, lens=[-0.08, 0.03])


def bundler(folder):
    rows = "\n".join(" ".join(map(str, r)) for r in (*(FLIP @ TURN), FLIP @ SHIFT))
    (folder / "bundle.out").write_text(f"# Bundle file v0.3\n2 0\n80 -0.08 0.03\n{rows}\n" + "0 0 0\n" * 5)
    (folder / "list.txt").write_text("./a.png 0 80\nb.png\n")
    return "bundle.out", camera(cx=31.5, cy=23.5, lens=[-0.08, 0.03])


def mve(folder):
    view = folder / "views" / "view_0000.mve"
    view.mkdir(parents=True)
    (folder / "a.png").rename(view / "undistorted.png")
    ini = f"""# MVE view meta data is stored in INI-file syntax.

[camera]
focal_length = 1.25
pixel_aspect = 1.0125
principal_point = {31 / 64} {24.75 / 48}
rotation = {" ".join(map(str, TURN.reshape(-1)))}
translation = {" ".join(map(str, SHIFT))}

[view]
id = 0
name = a.png
"""
    (view / "meta.ini").write_text(ini)
    return ".", camera(fy=81, lens=[])


def own(folder):
    view = {"image": "a.png", "K": camera().K.tolist(), "R": TURN.tolist(), "t": SHIFT.reshape(3, 1).tolist()}
    view |= {"width": 64, "height": 48, "model": "brown", "distortion": {"k1": -0.08, "k2": 0.03, "k3": -0.01, "p1": 0.004}}
    (folder / "views.json").write_text(json.dumps([{**view, "distortion": {**view["distortion"], "p2": -0.003}}]))
    return "views.json", camera()


WRITERS = [
    nerfstudio,
    instant_ngp,
    nerf_fisheye,
    splatting,
    openmvg,
    openmvg_nested,
    openmvg_fisheye,
    meshroom_old,
    meshroom_two_focals,
    meshroom_millimetres,
    meshroom_newest,
    meshroom_fisheye1,
    metashape,
    metashape_fisheye,
    metashape_old,
    realitycapture,
    realityscan,
    realitycapture_xmp,
    visualsfm,
    visualsfm_fixed,
    bundler,
    bundler_of_others,
    mve,
    own,
]


@pytest.mark.parametrize("write", WRITERS, ids=lambda f: f.__name__)
def test_every_file_gives_the_camera(folder, write):
    name, wanted = write(folder)
    found = read_photographs(folder / name)[0]
    np.testing.assert_allclose(found.camera.project(POINTS)[0], wanted.project(POINTS)[0], atol=1e-6)
    np.testing.assert_allclose(found.camera.center, CENTER, atol=1e-9)
    assert found.image.shape == (48, 64, 3)
    # The folder alone is enough.
    assert [p.name for p in read_photographs(folder)] == [p.name for p in read_photographs(folder / name)]


def test_realitycaptures_angles_are_those_of_its_matrix(tmp_path):
    """The same camera as RealityCapture wrote it to XMP and to its table."""
    matrix = "0.982594073038806 0.185426733553445 -0.0112166890261935 -0.032113633044729 0.11008102707942 -0.993403685341366"
    matrix = np.array([float(v) for v in f"{matrix} -0.18296885582437 0.976472781986697 0.114127".split()]).reshape(3, 3)
    write_image(np.zeros((48, 64, 3)), tmp_path / "a.png")
    row = "a.png,1,2,3,163.736597399311,83.4154313461628,174.386496244756,28"
    (tmp_path / "c.csv").write_text(f"#name,x,y,alt,heading,pitch,roll,f\n{row}\n")
    found = read_photographs(tmp_path / "c.csv")[0].camera
    np.testing.assert_allclose(found.R, matrix, atol=1e-5)
    np.testing.assert_allclose(found.center, [1, 2, 3], atol=1e-12)


def colmap_models(pycolmap):
    for name in pycolmap.CameraModelId.__members__:
        if name not in ("INVALID", "EQUIRECTANGULAR"):
            yield name


@pytest.mark.parametrize("kind", ["binary", "text"])
def test_colmaps_own_files_of_all_its_models(tmp_path, kind):
    pycolmap = pytest.importorskip("pycolmap")
    rng = np.random.default_rng(2)
    model, root = pycolmap.Reconstruction(), tmp_path / "sparse" / "0"
    root.mkdir(parents=True)
    (tmp_path / "images").mkdir()
    for number, name in enumerate(colmap_models(pycolmap), 1):
        one = pycolmap.Camera.create_from_model_name(number, name, 80.0, 64, 48)
        free = list(one.extra_params_idxs())
        params = np.array(one.params)
        params[free] = rng.uniform(-0.02, 0.02, len(free)) if name not in ("FOV", "EUCM") else [0.7, 1.1][-len(free) :]
        params[list(one.principal_point_idxs())] += [1.25, -0.75]
        one.params = params
        model.add_camera_with_trivial_rig(one)
        turn = Rotation.from_rotvec(rng.uniform(-0.3, 0.3, 3))
        image = pycolmap.Image(name=f"set {number % 2}/{name}.png", camera_id=number, image_id=number)
        model.add_image_with_trivial_frame(
            image, pycolmap.Rigid3d(pycolmap.Rotation3d(turn.as_quat()), rng.uniform(-0.3, 0.3, 3) + [0, 0, 4])
        )
        (tmp_path / "images" / f"set {number % 2}").mkdir(exist_ok=True)
        write_image(np.zeros((48, 64, 3)), tmp_path / "images" / f"set {number % 2}" / f"{name}.png")
    getattr(model, f"write_{kind}")(str(root))
    found = {p.name: p.camera for p in read_photographs(tmp_path)}
    assert len(found) == len(list(colmap_models(pycolmap))) >= 17
    for image in model.images.values():
        wanted = np.stack([image.project_point(p) for p in POINTS])
        np.testing.assert_allclose(found[image.name].project(POINTS)[0], wanted - 0.5, atol=1e-6, err_msg=image.name)
    for path in (root, root / f"cameras.{'bin' if kind == 'binary' else 'txt'}"):
        assert len(read_photographs(path)) == len(found)


def test_equirectangular_cameras_are_refused_by_name(tmp_path):
    (tmp_path / "cameras.txt").write_text("1 EQUIRECTANGULAR 64 48 64 48\n")
    (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 0 1 a.png\n\n")
    with pytest.raises(InputError, match="EQUIRECTANGULAR is not known"):
        read_photographs(tmp_path)


def test_a_transform_that_was_applied_is_undone_with_a_warning(folder):
    # nerfstudio's own for COLMAP: y and z exchanged, and one turned round.
    applied = np.array([[1, 0, 0, 0.3], [0, 0, 1, -0.2], [0, -1, 0, 0.1]])
    nerfstudio(folder)
    data = json.loads((folder / "transforms.json").read_text())
    moved = transform()
    moved[:3, :3] = applied[:, :3] @ moved[:3, :3]
    moved[:3, 3] = 2.0 * (applied[:, :3] @ CENTER + applied[:, 3])
    data["frames"][0]["transform_matrix"] = moved.tolist()
    data |= {"applied_transform": applied.tolist(), "applied_scale": 2.0}
    (folder / "transforms.json").write_text(json.dumps(data))
    with pytest.warns(IntaglioWarning, match="applied_transform"):
        found = read_photographs(folder)[0].camera
    np.testing.assert_allclose(found.project(POINTS)[0], camera().project(POINTS)[0], atol=1e-6)


# Photographs as they lie on disk


def one_view(folder, name="a.png", **change):
    view = {"image": name, "K": camera().K.tolist(), "R": TURN.tolist(), "t": SHIFT.tolist(), "width": 64, "height": 48}
    (folder / "cameras.json").write_text(json.dumps([{**view, **change}]))
    return folder / "cameras.json"


@pytest.mark.parametrize(
    "place", ["photos/day 1/a.png", "photos/A.PNG", "images/a.JPG", "a.tif", "sub/images/a.jpeg", "photos/a.webp", "photos/a.bmp"]
)
def test_photographs_are_found_below_and_under_other_names(tmp_path, place):
    target = tmp_path / place
    target.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", (64, 48), (90, 120, 60)).save(target)
    for name in ("a.png", "D:\\shots\\a.png", "/home/someone/shots/a.png", "a"):
        found = read_photographs(one_view(tmp_path, name))
        assert found[0].picture.samefile(target)
        assert found[0].image.shape == (48, 64, 3)
        assert read_photographs(one_view(tmp_path, name), images=tmp_path)[0].picture.samefile(target)


def test_a_folder_of_the_name_decides_between_equal_names(tmp_path):
    for place in ("one", "two"):
        (tmp_path / place).mkdir()
        write_image(np.zeros((48, 64, 3)), tmp_path / place / "a.png")
    assert read_photographs(one_view(tmp_path, "C:\\x\\Two\\a.png"))[0].picture == tmp_path / "two" / "a.png"
    with pytest.raises(InputError, match=r"could be .*one.a.png or .*two.a.png"):
        read_photographs(one_view(tmp_path, "a.png"))
    assert read_photographs(one_view(tmp_path, "a.png"), images=tmp_path / "one")[0].picture == tmp_path / "one" / "a.png"


def test_equal_names_in_several_folders_are_told_apart(tmp_path):
    meshroom_old(tmp_path)
    data = json.loads((tmp_path / "cameras.sfm").read_text())
    data["views"] = [{**data["views"][0], "path": f"/shots/{place}/a.png"} for place in ("left", "right")]
    for place, value in (("left", 0.2), ("right", 0.8)):
        (tmp_path / place).mkdir()
        write_image(np.full((48, 64, 3), value), tmp_path / place / "a.png")
    (tmp_path / "cameras.sfm").write_text(json.dumps(data))
    found = read_photographs(tmp_path)
    assert [p.name for p in found] == ["shots/left/a.png", "shots/right/a.png"]
    assert [p.picture.parent.name for p in found] == ["left", "right"]
    data["views"] = data["views"][:1] * 2
    (tmp_path / "cameras.sfm").write_text(json.dumps(data))
    with pytest.raises(InputError, match=r"names a view twice: shots/left/a\.png"):
        read_photographs(tmp_path)


def test_masks_are_no_photographs(tmp_path):
    for place in ("masks", "shots", "depths"):
        (tmp_path / place).mkdir()
        write_image(np.zeros((48, 64, 3)), tmp_path / place / "a.png")
    assert read_photographs(one_view(tmp_path))[0].picture == tmp_path / "shots" / "a.png"


def test_missing_photographs_are_left_out(folder):
    view = {"K": camera().K.tolist(), "R": TURN.tolist(), "t": SHIFT.tolist()}
    path = folder / "cameras.json"
    path.write_text(json.dumps({"a.png": view, "lost.png": view, "b.png": view}))
    with pytest.warns(IntaglioWarning, match=r"'lost.png' is missing and left out"):
        assert [p.name for p in read_photographs(path)] == ["a.png", "b.png"]
    with pytest.raises(FileError, match=r"'lost.png' is in none of"):
        read_photographs(path, strict=True)
    path.write_text(json.dumps({"lost.png": view, "gone.png": view}))
    with pytest.raises(FileError, match=r"2 of 2 photographs .*'lost.png'.* are in none of"):
        read_photographs(path)


@pytest.mark.parametrize("factor", [2, 4, 3, 0.5])
def test_calibrations_of_other_scales_are_scaled(tmp_path, factor):
    width, height = round(1000 / factor), round(751 / factor)
    write_image(np.zeros((height, width, 3)), tmp_path / "a.png")
    k = np.array([[800, 1, 480.0], [0, 810, 390], [0, 0, 1]])
    path = one_view(tmp_path, K=k.tolist(), width=1000, height=751)
    with pytest.warns(IntaglioWarning, match="'a.png, .*has another size than calibrated for; calibrations are scaled"):
        found = read_photographs(path)[0]
    assert found.image.shape == (height, width, 3)
    # Corners of pixels, not their centres, are what both have in common.
    large = Camera(K=k, R=TURN, t=SHIFT).project(POINTS)[0] + 0.5
    np.testing.assert_allclose(found.camera.project(POINTS)[0] + 0.5, large * (width / 1000, height / 751), atol=1e-9)
    with pytest.raises(InputError, match="another size"):
        read_photographs(path, strict=True)


def test_another_shape_is_refused_where_it_is_read(tmp_path):
    write_image(np.zeros((40, 40, 3)), tmp_path / "a.png")
    found = read_photographs(one_view(tmp_path))[0]
    with pytest.raises(InputError, match="40 x 40 pixels, its calibration is for 64 x 48"):
        found.read()


@pytest.mark.parametrize("orientation", [6, 8])
def test_the_calibrated_size_decides_how_a_portrait_lies(tmp_path, orientation):
    stored = np.random.default_rng(1).integers(0, 255, (48, 64, 3)).astype(np.uint8)
    image = Image.fromarray(stored)
    exif = image.getexif()
    exif[0x0112] = orientation
    image.save(tmp_path / "a.tif", exif=exif)
    upright = np.rot90(stored, -1 if orientation == 6 else 1)
    as_stored = read_photographs(one_view(tmp_path, "a.tif"))[0]
    turned_path = one_view(tmp_path, "a.tif", width=48, height=64, K=[[80, 0, 23], [0, 80, 31], [0, 0, 1]])
    with pytest.warns(IntaglioWarning, match="turned as EXIF says"):
        turned = read_photographs(turned_path)[0]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        unsized = read_photographs(one_view(tmp_path, "a.tif", width=64, height=48))[0]
    for photograph, wanted in ((as_stored, stored), (turned, upright), (unsized, stored)):
        image = photograph.image
        assert image.shape == wanted.shape
        order = np.argsort(image[:, :, 0].reshape(-1), kind="stable")
        assert (np.diff(wanted[:, :, 0].reshape(-1)[order].astype(int)) >= 0).all()


def test_a_project_is_searched_for_cameras(folder):
    view = {"K": camera().K.tolist(), "R": TURN.tolist(), "t": SHIFT.tolist()}
    (folder / "shots.json").write_text(json.dumps({"a.png": view}))
    assert len(read_photographs(folder)) == 1
    (folder / "more.json").write_text("{}")
    with pytest.raises(FileError, match=r"holds more.json and shots.json"):
        read_photographs(folder)
    empty = folder / "empty"
    empty.mkdir()
    with pytest.raises(FileError, match="holds no cameras that are known"):
        read_photographs(empty)


# What can be wrong


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"k1": 0.1}, "k1 would change the picture"),
        ({"distortion_coefficients": [0.1, 0, 0, 0]}, "distortion_coefficients would change"),
        ({"distCoeffs": [0.1]}, "distCoeffs would"),
        ({"distortion": {"k7": 0.1}}, "distortion has k7"),
        ({"distortion": [0.1] * 13}, "up to 12"),
        ({"model": "kannala"}, "model must be one of"),
        ({"width": 0}, "width must be whole pixels"),
        ({"width": "many"}, "width is no number"),
        ({"R": [[1, 0, 0], [0, 1, 0], [0, 0, "x"]]}, "R is no number"),
        ({"t": [0, 0]}, "t must be 3 numbers"),
        ({"t": [0, 0, float("nan")]}, "t is no number"),
        ({"image": 7}, "no file name"),
        ({"image": "x" * 5000}, "xxx…"),
    ],
)
def test_what_is_wrong_with_a_view_is_named(folder, change, message):
    with pytest.raises(IntaglioError, match=message) as caught:
        read_photographs(one_view(folder, **change))
    assert "cameras.json" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 600


def test_keys_that_say_nothing_are_no_matter(folder):
    assert read_photographs(one_view(folder, k1=0, skew=None, dist=[0, 0, 0.0], exposure=0.1, sensor="x"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * 100000, "nested too deeply"),
        ('{"a":' * 100000, "nested too deeply"),
        ("[1, 2]", "view 1 is no object"),
        ('{"frames": [{}]}', "frame 1 has no file_path"),
        ('{"frames": [{"file_path": "a.png"}]}', "transform_matrix must be 3 x 4"),
        ('{"frames": [{"file_path": "a.png", "camera_model": "LENS"}]}', "camera_model LENS is not known"),
        ('{"frames": [], "applied_scale": 0}', "applied_scale must be above 0"),
        ('{"frames": []}', "holds no view"),
        ('{"sfm_data_version": "0.3"}', "no list of intrinsics"),
        ('{"intrinsics": [], "views": [{"path": "a.png"}]}', "none of its 1 views has a pose"),
        ('{"intrinsics": [{"intrinsicId": 1}]}', "intrinsic 1: width is no number"),
    ],
)
def test_what_is_wrong_with_a_json_file_is_named(folder, text, message):
    (folder / "cameras.json").write_text(text)
    with pytest.raises(IntaglioError, match=message):
        read_photographs(folder / "cameras.json")


@pytest.mark.parametrize("key", ["k5", "s1", "b1", "ftheta_p0"])
def test_coefficients_that_nerf_files_give_in_vain_are_named(folder, key):
    nerfstudio(folder)
    data = json.loads((folder / "transforms.json").read_text())
    (folder / "transforms.json").write_text(json.dumps({**data, key: 0.1}))
    with pytest.raises(InputError, match=f"{key} is no coefficient of OPENCV"):
        read_photographs(folder)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("c.csv", "a,b\n1,2\n", "no column name"),
        ("c.csv", "#name,x,y,alt,heading,pitch,roll,f\na.png,1,2,3,4,5,6\n", "f is no number"),
        ("c.csv", "#name,x,y,alt,heading,pitch,roll,f\na.png,1,2,3,4,5,6,0\n", "positive focal lengths"),
        ("c.csv", "#name,x,y,alt,heading,pitch,roll,f,k5\na.png,1,2,3,4,5,6,28,0.1\n", "its lens has k5"),
        ("c.xml", "<document>", "is not XML"),
        ("c.xml", "<document/>", "has no chunk"),
        ("c.xml", '<!DOCTYPE x [<!ENTITY a "b">]><document/>', "defines entities"),
        ("c.xml", '<chunk><cameras><camera label="a"/></cameras></chunk>', "none of its 1 cameras is aligned"),
        ("c.out", "# Bundle file v0.3\n999999999 0\n", "can't hold them"),
        ("c.nvm", "NVM_V3\n\n999999999\n", "promises 999999999 views"),
        ("c.nvm", "NVM_V3\n\n1\na.png 80 1 0 0\n", "a view has 5 entries"),
        ("c.nvm", "NVM_V3\n\n1\na.png 80 0 0 0 0 1 2 3 0 0\n", "its quaternion has the length 0"),
        ("c_par.txt", "x\n", "no number of views"),
        ("c.mvs", "MVSI", "unknown camera file"),
    ],
)
def test_what_is_wrong_with_other_files_is_named(folder, name, text, message):
    (folder / name).write_text(text)
    with pytest.raises(IntaglioError, match=message) as caught:
        read_photographs(folder / name)
    assert name in str(caught.value)


def test_binary_models_that_promise_too_much_are_refused(tmp_path):
    camera_bytes = struct.pack("<QIiQQ4d", 1, 1, 1, 64, 48, 80, 80, 32, 24)
    view = struct.pack("<I7dI", 1, 1, 0, 0, 0, 0, 0, 5, 1) + b"a.png\0" + struct.pack("<Q", 0)
    write_image(np.zeros((48, 64, 3)), tmp_path / "a.png")
    for cameras, images, message in (
        (struct.pack("<Q", 2**60), b"", "cameras.bin: promises"),
        (camera_bytes[:-8], b"", "cameras.bin: ends after"),
        (camera_bytes[:12] + struct.pack("<i", 99) + camera_bytes[16:], b"", "model 99"),
        (camera_bytes, struct.pack("<Q", 2**62), "images.bin: promises"),
        (camera_bytes, struct.pack("<Q", 1) + view[:-8] + struct.pack("<Q", 2**61), "points"),
        (camera_bytes, struct.pack("<Q", 1) + view[:60] + struct.pack("<I", 7) + view[64:], "camera 7 is not among"),
        (camera_bytes, struct.pack("<Q", 1) + view.replace(b"\0" * 9, b"x" * 9)[:80], "ends in the middle of a name"),
    ):
        (tmp_path / "cameras.bin").write_bytes(cameras)
        (tmp_path / "images.bin").write_bytes(images or b"\0")
        with pytest.raises(IntaglioError, match=message):
            read_photographs(tmp_path)
    (tmp_path / "images.bin").write_bytes(struct.pack("<Q", 1) + view)
    assert len(read_photographs(tmp_path)) == 1


@pytest.mark.parametrize("arguments", [{"path": 3}, {"path": None}, {"images": 3}, {"strict": "yes"}])
def test_arguments_are_checked(folder, arguments):
    own(folder)
    with pytest.raises(InputError):
        read_photographs(**{"path": folder / "views.json", **arguments})


@pytest.mark.parametrize("write", WRITERS, ids=lambda f: f.__name__)
def test_damaged_files_end_in_one_line(folder, write):
    """Bytes lost, changed and repeated, numbers replaced: one of the package's errors, or a camera all the same."""
    name, _ = write(folder)
    path = folder / name if name != "." else next(p for p in folder.rglob("*") if p.suffix in (".xmp", ".ini"))
    whole, rng = path.read_bytes(), np.random.default_rng(11)
    for _ in range(60):
        data = bytearray(whole)
        what = rng.integers(5)
        at = int(rng.integers(len(data)))
        if what == 0:
            data = data[:at]
        elif what == 1:
            for place in rng.integers(0, len(data), 4):
                data[place] = rng.integers(256)
        elif what == 2:
            data = data[:at] + data[at + int(rng.integers(1, 20)) :]
        else:
            strange = [b"nan", b"1e999", b"-1", b"0", b"{}", b"[]", b"null", b'""', b"99999999999999999999", b"\xff"]
            data = data[:at] + strange[rng.integers(len(strange))] + data[at + int(rng.integers(8)) :]
        path.write_bytes(bytes(data))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", IntaglioWarning)
            message = ""
            try:
                for photograph in read_photographs(folder / name):
                    photograph.camera.project(POINTS)
            except IntaglioError as problem:
                message = str(problem)
        assert "\n" not in message
        assert len(message) < 1500


def test_a_name_that_is_given_twice_is_told_with_the_file(tmp_path):
    (tmp_path / "sfm_data.json").write_text('{"views": [{"key": 1, "key": 2}]}')
    with pytest.raises(InputError, match=r"sfm_data\.json: a name is given twice: key"):
        read_photographs(tmp_path / "sfm_data.json")
