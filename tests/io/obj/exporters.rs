//! OBJ and MTL files as exporters write them, with what they leave out and get wrong.

use super::{SQUARE, strict, vertices};
use crate::common::errors::{message, says};
use crate::common::folder::Folder;
use crate::common::materials::{base, specular};
use crate::written::constant;
use softray::prelude::*;

/// What is missing or malformed is left out, without strictness.
#[test]
fn what_is_not_there_is_left_out() {
    let folder = Folder::new("missing");
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\n";
    let gray = constant(base(&Material::default()));
    let first = |text: &str| {
        assert!(strict(&folder, text).is_err(), "{text}");
        let scene = folder.load(text).expect("a scene");
        (
            scene.objects[0].clone(),
            scene.objects[0].materials[0].clone(),
        )
    };
    let (_, material) = first(&format!(
        "mtllib none.mtl\n{triangle}usemtl a\nf 1/1 2/1 3/1\n"
    ));
    assert_eq!(
        (material.name.as_str(), constant(base(&material))),
        ("a", gray)
    );

    folder.write("text.png", "no image");
    let textured = format!("mtllib m.mtl\n{triangle}usemtl m\nf 1/1 2/1 3/1\n");
    for (mtl, expected) in [
        ("newmtl m\nKd 1 0 0\nmap_Kd none.png\n", [1.0, 0.0, 0.0]),
        ("newmtl m\nKd 0 1 0\nmap_Kd text.png\n", [0.0, 1.0, 0.0]),
        ("newmtl m\nmap_Kd none.png\n", gray),
        ("newmtl m\nKd 0 0 1\nKd 0.1 0.2\n", [0.0, 0.0, 1.0]),
        ("newmtl m\nKd 0 0 1\nNs much\nmap_Kd\n", [0.0, 0.0, 1.0]),
        ("newmtl m\nKd 0 0 1\nnewmtl\nKd 1 1 1\n", [0.0, 0.0, 1.0]),
    ] {
        folder.write("m.mtl", mtl);
        let (_, material) = first(&textured);
        assert_eq!(constant(base(&material)), expected, "{mtl}");
    }
    // Corners that name what the file has not, and lines that are no faces.
    for faces in [
        "f 1/2/1 2/2/1 3/2/1\n",
        "f 1/-9 2/0 3\n",
        "f 1 2\nf\nf 1 2 3\n",
    ] {
        let (object, _) = first(&format!("{triangle}{faces}"));
        assert_eq!(object.mesh.faces.len(), 1, "{faces}");
        assert!(object.mesh.uvs.is_none() && object.mesh.normals.is_none());
    }
    // Below a texture coordinate that is not there, a normal is.
    let normals = format!("{triangle}vn 0 0 1\n");
    let (object, _) = first(&format!("{normals}f 1/7/1 2/7/1 3/7/1\n"));
    assert!(object.mesh.uvs.is_none() && object.mesh.normals.is_some());
}

/// Of `Kd` and `Ks` together no more light comes than arrives; without a highlight `Ks` counts for nothing.
#[test]
fn gloss_beside_a_color() {
    let folder = Folder::new("energy");
    let mut image = image::RgbImage::new(2, 1);
    image.put_pixel(0, 0, image::Rgb([188, 188, 188]));
    image.save(folder.path("half.png")).expect("a PNG file");
    let half = f64::from(
        HostImage::read(folder.path("half.png"))
            .expect("an image")
            .pixels[0],
    );
    image.put_pixel(0, 0, image::Rgb([255, 0, 0]));
    image.save(folder.path("red.png")).expect("a PNG file");
    let blender = "newmtl m\nKd 0.8 0.8 0.8\nKs 0.5 0.5 0.5\n";
    for (rest, expected) in [
        ("Ns 96\nillum 2\n", 0.2),
        ("Ns 96\n", 0.2),
        ("illum 2\n", 0.2),
        ("Ns 0\nillum 2\n", 0.0),
        ("Ns 96\nillum 1\n", 0.0),
        ("Ns 96\nillum 0\n", 0.0),
        ("Ns 96\nKd 0.5 0.25 0\n", 0.5),
        ("Ns 96\nKd 0.75 0.25 0\n", 0.25),
        ("Ns 96\nKd 7 0 0\n", 0.0),
        ("Ns 96\nKd 0 0 0\nKs 2 2 2\n", 1.0),
        ("Ns 96\nmap_Kd half.png\nKs 0.9 0.9 0.9\n", 1.0 - half),
        ("Ns 96\nmap_Kd red.png\n", 0.0),
        ("Ns 0\nmap_Kd half.png\nmap_Ks half.png\n", 0.0),
    ] {
        folder.write("m.mtl", format!("{blender}{rest}"));
        let text = format!("mtllib m.mtl\n{SQUARE}vt 0 0\nusemtl m\nf 1/1 2/1 3/1\n");
        let scene = folder.load(text).expect("a scene");
        let found = constant(specular(&scene.objects[0].materials[0]));
        let close = found.iter().all(|v| (v - expected).abs() < 1e-6);
        assert!(close, "{rest}: {found:?}, expected {expected}");
    }
    // Where both are textures of one size, what counts is the place of the texels.
    image.put_pixel(0, 0, image::Rgb([0, 0, 0]));
    image.put_pixel(1, 0, image::Rgb([255, 0, 0]));
    image.save(folder.path("other.png")).expect("a PNG file");
    folder.write(
        "m.mtl",
        "newmtl m\nKs 1 1 1\nmap_Kd red.png\nmap_Ks other.png\n",
    );
    let text = format!("mtllib m.mtl\n{SQUARE}vt 0 0\nusemtl m\nf 1/1 2/1 3/1\n");
    let scene = folder.load(text).expect("a scene");
    let ColorTexture::Texture { texels, .. } = specular(&scene.objects[0].materials[0]) else {
        panic!("no texture");
    };
    let found = HostImage::from_tensor(texels).expect("values").pixels;
    assert_eq!(found, [0.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
}

/// A textured surface in light of 1 from everywhere is no brighter than that: with `Ks` beside a bright texture it
/// was.
#[test]
fn textures_with_gloss_keep_energy() {
    let folder = Folder::new("furnace");
    let bright = HostImage::new(1, 1, vec![0.75; 3]).expect("an image");
    bright.write(folder.path("a.exr")).expect("a file");
    folder.write(
        "m.mtl",
        "newmtl m\nKd 0.8 0.8 0.8\nKs 0.5 0.5 0.5\nNs 20\nillum 2\nmap_Kd a.exr\n",
    );
    let text = format!("mtllib m.mtl\n{SQUARE}vt 0 0\nusemtl m\nf 1/1 2/1 3/1 4/1\n");
    let scene = folder
        .load(text)
        .expect("a scene")
        .with_environment([1.0; 3]);
    let camera = Camera::look_at([0.5, 0.5, 4.0], [0.5, 0.5, 0.0]).with_fov_y(10.0);
    let options = RenderOptions::new(4, 4).with_samples(256).with_bounces(1);
    let image = render(&scene, &camera, &options).expect("an image");
    let mean = image.mean().expect("values");
    assert!(mean.iter().all(|&m| m > 0.9 && m < 1.001), "{mean:?}");
}

#[test]
fn colors_of_vertices() {
    let folder = Folder::new("colors");
    let text = "o a\nv 0 0 0 1 0 0\nv 1 0 0 0 0.5 1\nv 0 1 0\nf 1 2 3\no b\nv 0 0 1\nf 1 2 4\n\
                o white\nv 1 1 1 1 1 1\nv 2 2 2\nf 3 5 6\n";
    let scene = folder.load(text).expect("a scene");
    let colors = |object: &Object| -> Option<Vec<f64>> {
        let colors = object.mesh.colors.as_ref()?;
        assert_eq!(colors.faces, object.mesh.faces);
        Some(colors.values.to_data().iter::<f64>().collect())
    };
    let half = 0.214_041_14;
    for (object, expected) in scene.objects.iter().zip([
        Some([1.0, 0.0, 0.0, 0.0, half, 1.0, 1.0, 1.0, 1.0]),
        Some([1.0, 0.0, 0.0, 0.0, half, 1.0, 1.0, 1.0, 1.0]),
        None,
    ]) {
        let found = colors(object);
        let near = |(f, e): (&f64, &f64)| (f - e).abs() < 1e-6;
        match (&found, &expected) {
            (Some(f), Some(e)) => assert!(f.iter().zip(e).all(near), "{f:?}"),
            _ => assert_eq!(found.is_some(), expected.is_some(), "{}", object.name),
        }
        // What has no material shows the colors as they are.
        assert_eq!(constant(base(&object.materials[0])), [1.0; 3]);
    }
    assert_eq!(vertices(&scene.objects[0])[1], [1.0, 0.0, 0.0]);

    // Bytes, values that are no colors, and w among them.
    let text = "v 0 0 0 255 0 0\nv 1 0 0 0 nan 1\nv 0 2 0 2\nf 1 2 3\n";
    let scene = folder.load(text).expect("a scene");
    let found = colors(&scene.objects[0]).expect("colors");
    assert_eq!(found[..5], [1.0, 0.0, 0.0, 0.0, 1.0]);
    assert!(found[5] > 0.0 && found[5] < 1e-3, "{found:?}");
    assert_eq!(found[6..], [1.0; 3]);
    assert_eq!(vertices(&scene.objects[0])[2], [0.0, 1.0, 0.0]);
}

/// x, y and z are divided by w; five numbers are three and more.
#[test]
fn homogeneous_vertices() {
    let folder = Folder::new("homogeneous");
    let text = "v 2 4 6 2\nv 1 0 0 9 9\nv 0 1 0 1\nf 1 2 3\n";
    let scene = folder.load(text).expect("a scene");
    let expected = [[1.0, 2.0, 3.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    assert_eq!(vertices(&scene.objects[0]), expected);
    says(
        message(folder.load("v 2 4 6 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")),
        ["line 1"],
    );
}

#[test]
fn several_files_of_materials() {
    let folder = Folder::new("libraries");
    folder.write("a.mtl", "newmtl a\nKd 1 0 0\n");
    folder.write("b c.mtl", "newmtl b\nKd 0 1 0\n");
    folder.write("d.mtl", "newmtl d\nKd 0 0 1\n");
    let text = format!(
        "mtllib a.mtl d.mtl\nmtllib b c.mtl\n{SQUARE}usemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\nusemtl d\nf 1 2 4\n"
    );
    let scene = strict(&folder, &text).expect("a scene");
    let materials = scene.objects[0].materials.iter();
    let found: Vec<_> = materials.map(|m| constant(base(m))).collect();
    assert_eq!(found, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
}

#[test]
fn bmp_and_tga_textures() {
    let folder = Folder::new("formats");
    let mut image = image::RgbImage::new(1, 1);
    image.put_pixel(0, 0, image::Rgb([255, 0, 255]));
    for name in ["a.bmp", "a.tga"] {
        image.save(folder.path(name)).expect("a file");
        folder.write("m.mtl", format!("newmtl m\nmap_Kd {name}\n"));
        let text = format!("mtllib m.mtl\n{SQUARE}vt 0 0\nusemtl m\nf 1/1 2/1 3/1\n");
        let scene = strict(&folder, &text).expect("a scene");
        let ColorTexture::Texture { texels, .. } = base(&scene.objects[0].materials[0]) else {
            panic!("no texture");
        };
        let found = HostImage::from_tensor(texels).expect("values").pixels;
        assert_eq!(found, [1.0, 0.0, 1.0], "{name}");
    }
}
