use super::*;

fn flat(width: usize, height: usize, value: f32) -> HostImage {
    HostImage::new(width, height, vec![value; 3 * width * height]).expect("an image")
}

fn decay(title: &str) -> Plot {
    let points = (0..200).map(|k| (f64::from(k), (-0.05 * f64::from(k)).exp()));
    Plot::new(title, "step", "loss")
        .with_log_scale()
        .with_curve("a curve", points)
}

/// A figure with all features and a given text everywhere.
fn full(text: &str) -> Figure {
    let values: Vec<f64> = (0..64).map(|k| f64::from(k) - 32.0).collect();
    let mut plot = decay(text).with_line(text, 0.01);
    for k in 0..9 {
        plot = plot.with_curve(
            format!("{text} {k}"),
            [(0.0, 1.0), (200.0, 0.1 + f64::from(k))],
        );
    }
    Figure::new(text)
        .with_height(64)
        .with_row([(text, &flat(8, 8, 0.4)), ("", &flat(3, 2, 0.9))])
        .with_row([
            Panel::signed(text, 8, 8, values),
            Panel::new(text, &flat(64, 16, 2.0)),
        ])
        .with_plot(plot)
        .with_plot(Plot::new(text, text, text).with_curve("", [(1.0, f64::NAN)]))
        .with_plot(decay("b"))
        .with_plot(decay("c"))
}

/// The margins stay empty, so no text leaves the page.
#[test]
fn margins_stay_white() {
    let long = "a text that is much longer than what it stands above or below, \
                withwordsthataremuchlongerthanalinecanbeonanyfigureofthissizewhateveritis";
    for text in ["", "short", long, &long.repeat(3)] {
        let image = full(text).image().expect("a figure");
        let (w, h) = (image.width, image.height);
        let white = |x: usize, y: usize| image.pixels[3 * (y * w + x)..][..3] == [1.0; 3];
        for inset in [0, MARGIN - 3] {
            let edges = (0..w).flat_map(|x| [(x, inset), (x, h - 1 - inset)]);
            let sides = (0..h).flat_map(|y| [(inset, y), (w - 1 - inset, y)]);
            for (x, y) in edges.chain(sides) {
                assert!(white(x, y), "{x}, {y} of {w} × {h}: {text:?}");
            }
        }
    }
}

/// The color scale is beside the image, from red at the top to blue at the bottom.
#[test]
fn signed_images_have_a_scale_beside_them() {
    let figure = |panel: Panel| Figure::new("").with_row([panel]).image().expect("a figure");
    let signed = figure(Panel::signed("", 4, 4, [1.0; 16]));
    let plain = figure(Panel::new("", &flat(4, 4, 0.5)));
    assert_eq!(signed.height, plain.height);
    let pixel = |x: usize, y: usize| &signed.pixels[3 * (y * signed.width + x)..][..3];
    let colored = |x: &usize, y: usize| pixel(*x, y)[0] != pixel(*x, y)[2];
    let frame = MARGIN + 256 + 2;
    let columns: Vec<usize> = (frame..signed.width)
        .filter(|x| colored(x, MARGIN + 3))
        .collect();
    assert!(
        columns.len() >= 10 && columns[0] < frame + 12,
        "{columns:?}"
    );
    let middle = columns[columns.len() / 2];
    let (top, bottom) = (pixel(middle, MARGIN + 3), pixel(middle, MARGIN + 254));
    assert!(
        top[0] > 3.0 * top[2] && bottom[2] > 3.0 * bottom[0],
        "{top:?}, {bottom:?}"
    );
    let center = pixel(middle, MARGIN + 1 + 128);
    assert!(center.iter().all(|v| *v > 0.95), "{center:?}");
    // The image has the color of the scale's upper end, and numbers are to the right.
    assert_eq!(
        pixel(MARGIN + 100, MARGIN + 100),
        Diverging::of(&[1.0]).color(1.0)
    );
    let ink = |x: usize| (0..signed.height).any(|y| pixel(x, y)[0] < 0.1);
    assert!((middle + 12..signed.width).any(ink));
}

/// A curve's end points are at the ends of the axes.
#[test]
fn curves_fill_their_frames() {
    let plot = Plot::new("", "", "").with_curve("", [(0.0, 0.0), (1.0, 1.0)]);
    let image = Figure::new("").with_plot(plot).image().expect("a figure");
    let blue = |i: &usize| {
        let p = &image.pixels[3 * i..3 * i + 3];
        p[2] > p[0] + 0.2
    };
    let inked: Vec<usize> = (0..image.width * image.height).filter(blue).collect();
    let (first, last) = (inked[0], inked[inked.len() - 1]);
    assert!(first / image.width < 60 && first % image.width > image.width - 60);
    assert!(last / image.width > image.height - 80 && last % image.width < 100);
}

#[test]
fn mistakes_are_named() {
    let folder = std::env::temp_dir().join(format!("softray-figure-{}", std::process::id()));
    let figure = Figure::new("").with_row([("gray", &flat(2, 2, 0.5))]);
    let missing = figure.write(folder.join("a.png")).expect_err("no folder");
    assert!(
        missing.to_string().contains("there is no folder"),
        "{missing}"
    );
    assert!(figure.write("a.svg").is_err());
    std::fs::create_dir(&folder).expect("a folder");
    let path = folder.join("a.png");
    std::fs::create_dir(&path).expect("a folder in the way");
    let error = figure.write(&path).expect_err("a folder is there");
    assert!(error.to_string().contains("it is a folder"), "{error}");
    assert_eq!(std::fs::read_dir(&folder).expect("a folder").count(), 1);
    std::fs::remove_dir_all(&folder).expect("a folder");
    let large = Figure::new("")
        .with_height(1 << 20)
        .with_row([("", &flat(2, 1, 0.0))]);
    let error = large.image().expect_err("too large").to_string();
    assert!(error.contains("figure: size is"), "{error}");
    let empty = Figure::new("")
        .with_row(Vec::<Panel>::new())
        .image()
        .expect("a page");
    assert_eq!(empty.height, 2 * MARGIN);
}

/// Up is up in pictures, the object is wholly in view from all sides, and a tilt of `up` is undone.
#[test]
fn relit_objects_stand_upright() {
    let device = burn::tensor::Device::flex();
    // A pyramid with its top up.
    let base = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    let base = base.map(|[x, z]| [2.0 + 0.4 * x, -1.0, 0.4 * z]);
    let corners = [base.as_slice(), &[[2.0, 1.0, 0.0]]].concat();
    let faces = vec![
        [0, 1, 2],
        [0, 2, 3],
        [1, 0, 4],
        [2, 1, 4],
        [3, 2, 4],
        [0, 3, 4],
    ];
    let tall = crate::scene::Mesh::from_host(&corners, faces, &device);
    let shown = |axis: [f64; 3], angle: f64, up: [f64; 3]| {
        let object = crate::scene::Object::new(tall.clone().rotated(axis, angle));
        let frames = Relighting::new(&object, up)
            .expect("an object")
            .turntable(32);
        frames.expect("pictures").frames().to_vec()
    };
    let upright = shown([1.0, 0.0, 0.0], 0.0, [0.0, 1.0, 0.0]);
    let turned = shown([1.0, 0.0, 0.0], 90.0, [0.0, 0.0, 1.0]);
    assert_eq!([upright.len(), turned.len()], [36; 2]);
    for image in upright.iter().chain(&turned) {
        let at = |x: usize, y: usize| image.pixels[3 * (32 * y + x) + 2];
        let floor = at(0, 31);
        let shows = |&(x, y): &(usize, usize)| (at(x, y) - floor).abs() > 0.02;
        let border = (0..32).flat_map(|k| [(k, 0), (k, 31), (0, k), (31, k)]);
        assert_eq!(border.filter(shows).count(), 0);
        let width = |y: usize| (0..32).map(|x| (x, y)).filter(shows).count();
        let halves = [0..16, 16..32].map(|rows| rows.map(width).sum::<usize>());
        assert!(halves[1] > 2 * halves[0] && halves[0] > 0, "{halves:?}");
    }
    let mean = |images: &[HostImage]| images.iter().flat_map(HostImage::mean).sum::<f64>();
    let ratio = mean(&turned) / mean(&upright);
    assert!((ratio - 1.0).abs() < 0.02, "{ratio}");
    let object = crate::scene::Object::new(tall.clone());
    let error = Relighting::new(&object, [0.0, 2.0, 0.0]).expect_err("no unit vector");
    assert!(error.to_string().contains("a unit vector"), "{error}");
}
