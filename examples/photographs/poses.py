# /// script
# requires-python = ">=3.10"
# dependencies = ["pycolmap==4.2.1", "pillow==12.3.0"]
# ///
"""Camera poses of a folder of photographs by COLMAP: writes FOLDER/sparse/0, which the example `photographs` reads.

Run it by `uv run poses.py FOLDER`, or by `pip install pycolmap==4.2.1 pillow==12.3.0` and `python poses.py FOLDER`.
Photographs are in FOLDER/images, or in FOLDER itself. Masks are FOLDER/masks/NAME.png (white on the object) or the
alpha of the photographs. Features are drawn inside of the masks alone, because on a turntable the background stands
still. A smooth object gives few features, so these have affine shapes and pooled domains, and matching is guided.
"""
import argparse
import pathlib
import shutil
import sys
import tempfile

import pycolmap
from PIL import Image

SUFFIXES = {".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp"}
MODELS = ["SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV"]


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("folder", type=pathlib.Path, help="folder with images/ (or the photographs) and perhaps masks/")
    parser.add_argument("--masks", type=pathlib.Path, help="folder of masks (default: FOLDER/masks)")
    parser.add_argument("--no-masks", action="store_true", help="draw features everywhere: the background moves along")
    parser.add_argument("--camera", default=MODELS[2], choices=MODELS, help="COLMAP's model (default: %(default)s)")
    parser.add_argument("--several-cameras", action="store_true", help="a focal length for each photograph")
    parser.add_argument("--plain", action="store_true", help="COLMAP's default features: faster, places fewer")
    parser.add_argument("--force", action="store_true", help="replace FOLDER/sparse")
    return parser.parse_args()


def photographs(folder, several):
    """The folder of the photographs, and their names."""
    if not folder.is_dir():
        sys.exit(f"{folder} is no folder")
    images = folder / "images" if (folder / "images").is_dir() else folder
    names = sorted(p.name for p in images.iterdir() if p.suffix.lower() in SUFFIXES)
    if len(names) < 3:
        sys.exit(f"{images} has {len(names)} photographs ({', '.join(sorted(SUFFIXES))}); poses need at least 3")
    sizes = {Image.open(images / n).size for n in names}
    if len(sizes) > 1 and not several:
        sys.exit(f"the photographs have several sizes ({sorted(sizes)}); --several-cameras allows that")
    return images, names


def mask_of(photo, folder):
    """The mask of a photograph, from a file or from its alpha, or None."""
    for name in (f"{photo.stem}.png", f"{photo.name}.png", f"{photo.stem}.jpg"):
        if folder.is_dir() and (folder / name).exists():
            mask = Image.open(folder / name)
            return mask.getchannel("A") if mask.mode in ("RGBA", "LA") else mask.convert("L")
    image = Image.open(photo)
    return image.getchannel("A") if image.mode in ("RGBA", "LA") else None


def write_masks(images, names, given, out):
    """Writes masks as COLMAP names them (a.jpg.png), and returns how many there were."""
    found = 0
    for name in names:
        mask, size = mask_of(images / name, given), Image.open(images / name).size
        found += mask is not None
        mask = mask or Image.new("L", size, 255)
        if mask.size != size:
            sys.exit(f"the mask of {name} has {mask.size} pixels, the photograph {size}")
        mask = mask.point(lambda value: 255 * (value > 127))
        if not mask.getbbox():
            sys.exit(f"the mask of {name} is black everywhere; masks are white on the object")
        mask.save(out / f"{name}.png")
    return found


def reconstruct(args, images, names, work):
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = args.camera
    (masks := work / "masks").mkdir()
    if not args.no_masks:
        found = write_masks(images, names, args.masks or args.folder / "masks", masks)
        print(f"{found} of {len(names)} photographs have masks")
        if found:
            reader.mask_path = str(masks)
    features, matching = pycolmap.FeatureExtractionOptions(), pycolmap.FeatureMatchingOptions()
    if not args.plain:
        features.sift.peak_threshold = 0.002
        features.sift.estimate_affine_shape = True
        features.sift.domain_size_pooling = True
        matching.guided_matching = True
    mode = pycolmap.CameraMode.PER_IMAGE if args.several_cameras else pycolmap.CameraMode.SINGLE
    database = work / "database.db"
    pycolmap.extract_features(database, images, names, mode, reader, features)
    pycolmap.match_exhaustive(database, matching_options=matching)
    models = pycolmap.incremental_mapping(database, images, work)
    return max(models.values(), key=lambda m: m.num_reg_images(), default=None)


def main():
    args = arguments()
    images, names = photographs(args.folder, args.several_cameras)
    if (target := args.folder / "sparse").exists() and not args.force:
        sys.exit(f"{target} is there already; --force replaces it")
    with tempfile.TemporaryDirectory() as work:
        model = reconstruct(args, images, names, pathlib.Path(work))
    if model is None:
        sys.exit("COLMAP placed no photographs: neighbors have to show the same parts, sharp and with some texture")
    shutil.rmtree(target, ignore_errors=True)
    (target / "0").mkdir(parents=True)
    model.write(target / "0")
    missing = sorted(set(names) - {i.name for i in model.images.values() if i.has_pose})
    placed, error = len(names) - len(missing), model.compute_mean_reprojection_error()
    print(f"{placed} of {len(names)} photographs placed in {target / '0'}, reprojection error {error:.2f} pixels")
    if missing:
        print("not placed: " + ", ".join(missing))


if __name__ == "__main__":
    main()
