//! The fitting loop: it descends, keeps a history, clips, stops, and survives being killed.

use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;

use crate::common;
use crate::common::errors::{message, says};
use crate::common::process::again;
use crate::common::values;
use burn::module::{Module, Param};
use burn::optim::{AdamConfig, SgdConfig};
use burn::tensor::Device;
use softray::optim::{BlurSchedule, Evaluation, Fit, Fitted, PlateauBlur, Rate, Step, Stop, loss};
use softray::prelude::*;

#[derive(Module, Debug)]
pub struct Point {
    pub at: Param<Tensor<1>>,
}

pub fn point(at: &[f32]) -> Point {
    let at = Tensor::from_floats(at, &Device::flex().autodiff());
    Point {
        at: Param::from_tensor(at),
    }
}

pub fn place(point: &Point) -> Vec<f64> {
    values(&point.at.val())
}

/// |x|², and noise that is a function of the step alone.
pub fn bowl(point: &Point, step: &Step) -> softray::Result<Evaluation> {
    let noise = (step.seed(0) % 97) as f64 / 97.0 - 0.5;
    let x = point.at.val();
    let loss = (x.clone() * x.clone()).sum() + x.sum() * (0.1 * noise);
    Ok(Evaluation::new(loss).with_value("first", place(point)[0]))
}

pub fn folder(name: &str) -> PathBuf {
    common::target_folder(&format!("fit-{name}"))
}

pub fn adam() -> burn::optim::ModuleOptimizer {
    AdamConfig::new().init()
}

#[test]
fn it_descends_and_keeps_a_history() {
    let folder = folder("history");
    let seen = std::rc::Rc::new(std::cell::RefCell::new(Vec::new()));
    let steps = seen.clone();
    let fitted = Fit::new(point(&[1.0, -2.0]), adam(), 300)
        .with_progress(false)
        .with_rate(Rate::cosine(0.05))
        .with_blur(BlurSchedule::decay(1e-1, 1e-3, 200).expect("a schedule"))
        .with_folder(&folder)
        .on_step(100, move |report| {
            steps.borrow_mut().push(report.step.index);
            assert_eq!(report.history.rows.len(), report.step.index + 1);
            Ok(true)
        })
        .run(bowl)
        .expect("a fit");
    let at = place(&fitted.module);
    assert!(at.iter().all(|x| x.abs() < 0.02), "{at:?}");
    assert_eq!(*seen.borrow(), [0, 100, 200, 299]);
    assert_eq!(fitted.stop, Stop::Steps);
    assert_eq!(fitted.history.curve("first")[0], (0.0, 1.0));
    assert_eq!(fitted.history.curve("blur")[0], (0.0, 1e-1));
    assert_eq!(fitted.history.curve("blur")[250], (250.0, 1e-3));
    let csv = std::fs::read_to_string(folder.join("history.csv")).expect("a history");
    assert_eq!(csv, fitted.history.to_csv());
    assert_eq!(csv.lines().count(), 301);
    let plots = HostImage::read(folder.join("history.png")).expect("plots");
    // Three plots side by side: the blur has a schedule.
    assert!(plots.width > 3 * 400 && plots.height > 250, "{plots:?}");
    let kept = std::fs::read_dir(folder.join("checkpoints")).expect("checkpoints");
    assert_eq!(kept.count(), 2);
}

/// The gradient of the bowl at (3, 4) is 10 long; clipped to 1, a step of rate 0.1 is 0.1 long.
#[test]
fn gradients_are_clipped_by_their_norm() {
    let step = |clip: Option<f64>| {
        let fit = Fit::new(point(&[3.0, 4.0]), SgdConfig::new().init(), 1)
            .with_progress(false)
            .with_rate(0.1);
        let fit = match clip {
            Some(norm) => fit.with_clip(norm),
            None => fit,
        };
        let fitted = fit
            .run(|p: &Point, _: &_| {
                let x = p.at.val();
                Ok(Evaluation::new((x.clone() * x).sum()))
            })
            .expect("a step");
        assert!((fitted.history.rows[0].gradient_norm - 10.0).abs() < 1e-5);
        place(&fitted.module)
    };
    let close = |a: Vec<f64>, b: [f64; 2]| a.iter().zip(b).all(|(x, y)| (x - y).abs() < 1e-6);
    assert!(close(step(None), [2.4, 3.2]));
    assert!(close(step(Some(100.0)), [2.4, 3.2]));
    assert!(close(step(Some(1.0)), [3.0 - 0.06, 4.0 - 0.08]));
}

#[test]
fn it_stops_where_the_loss_is_flat_and_stays_stopped() {
    let folder = folder("early");
    let run = || {
        Fit::new(point(&[0.5]), adam(), 2000)
            .with_progress(false)
            .with_rate(0.02)
            .with_early_stop(60)
            .with_folder(&folder)
            .run(bowl)
            .expect("a fit")
    };
    let first = run();
    assert_eq!(first.stop, Stop::Early);
    let steps = first.history.rows.len();
    assert!((120..1000).contains(&steps), "{steps}");
    assert_eq!(first.plateaus, [steps - 1]);
    let second = run();
    assert_eq!(second.stop, Stop::Early);
    assert_eq!(second.resumed, Some(steps));
    assert_eq!(place(&second.module), place(&first.module));
}

/// While the blur still falls the loss may rise without the fit having ended.
#[test]
fn blur_that_follows_the_loss_falls_where_it_is_flat() {
    let fit = |folder: Option<&Path>, last: usize| {
        let blur = PlateauBlur::new(1e-1, 1e-3, 0.5, 20).expect("a schedule");
        let fit = Fit::new(point(&[0.5]), adam(), 400)
            .with_progress(false)
            .with_rate(0.02)
            .with_blur(blur);
        let fit = fit.on_step(1, move |report| Ok(report.step.index < last));
        let fit = match folder {
            Some(folder) => fit.with_folder(folder).with_checkpoint_every(7),
            None => fit,
        };
        fit.run(bowl).expect("a fit").history
    };
    let whole = fit(None, 400);
    let last = whole.rows[399].blur.expect("a schedule");
    assert!(last < 2e-2, "{last}");
    // Resumed, it goes on where it was.
    let folder = folder("plateau");
    fit(Some(&folder), 150);
    let resumed = fit(Some(&folder), 400);
    assert_eq!(resumed.curve("blur"), whole.curve("blur"));
    assert_eq!(resumed.curve("loss"), whole.curve("loss"));
}

/// a ← d a + (1 − d) p with d = min(decay, n / (n + 9)) after n steps.
#[test]
fn parameters_are_averaged() {
    let fit = |decay: f64| {
        Fit::new(point(&[3.0, -4.0]), SgdConfig::new().init(), 30)
            .with_progress(false)
            .with_rate(0.1)
            .with_average(decay)
    };
    let seen = std::rc::Rc::new(std::cell::RefCell::new(Vec::new()));
    let places = seen.clone();
    let fitted = fit(0.5).on_step(1, move |report| {
        places.borrow_mut().push(place(report.module));
        Ok(true)
    });
    let fitted = fitted.run(bowl).expect("a fit");
    let mut places = seen.borrow().clone();
    places.push(place(&fitted.module));
    let mut average = places[0].clone();
    for (n, place) in places.iter().enumerate().skip(1) {
        let keep = (n as f64 / (n as f64 + 9.0)).min(0.5);
        average = average
            .iter()
            .zip(place)
            .map(|(a, p)| keep * a + (1.0 - keep) * p)
            .collect();
    }
    let found = place(&fitted.average.expect("an average"));
    let apart = found.iter().zip(&average).map(|(a, b)| (a - b).abs());
    assert!(apart.fold(0.0, f64::max) < 1e-6, "{found:?}, {average:?}");
    assert!(
        found
            .iter()
            .zip(&places[30])
            .all(|(a, p)| (a - p).abs() > 1e-4)
    );
    says(message(fit(1.0).run(bowl)), ["average", "below 1"]);
}

/// Bytes that changed, in any file of a checkpoint: the one before it serves, and the fit ends the same.
#[test]
fn damaged_checkpoints_are_passed_over() {
    let folder = folder("damaged");
    let fit = |last: usize| {
        Fit::new(point(&[0.5, -1.0]), adam(), 40)
            .with_progress(false)
            .with_average(0.9)
            .with_checkpoint_every(5)
            .with_folder(&folder)
            .on_step(1, move |report| Ok(report.step.index < last))
            .run(bowl)
    };
    let whole = Fit::new(point(&[0.5, -1.0]), adam(), 40)
        .with_progress(false)
        .with_average(0.9)
        .run(bowl);
    let places = |fitted: Fitted<Point>| {
        [Some(fitted.module), fitted.average].map(|p| place(&p.expect("a point")))
    };
    let whole = places(whole.expect("a fit"));
    let checkpoints = folder.join("checkpoints");
    for file in [
        "module.bpk",
        "average.bpk",
        "optimizer.bpk",
        "history.csv",
        "settings.txt",
        "checksums.txt",
    ] {
        for cut in [false, true] {
            std::fs::remove_dir_all(&folder).ok();
            fit(22).expect("a fit"); // Checkpoints after 20 and 23 steps.
            let path = checkpoints.join("00000023").join(file);
            let mut bytes = std::fs::read(&path).expect("a file");
            let middle = bytes.len() / 2;
            if cut {
                bytes.truncate(middle);
            } else {
                bytes[middle] ^= 0x10;
            }
            std::fs::write(&path, bytes).expect("a file");
            let resumed = fit(40).expect("a fit");
            assert_eq!(resumed.resumed, Some(20), "{file}");
            assert_eq!(places(resumed), whole, "{file}");
        }
    }
    // All of them damaged: not a new beginning.
    for entry in std::fs::read_dir(&checkpoints).expect("checkpoints") {
        let path = entry.expect("an entry").path().join("module.bpk");
        std::fs::write(path, "nothing").expect("a file");
    }
    says(message(fit(40)), ["module.bpk"]);
}

#[test]
fn one_process_fits_in_a_folder() {
    let folder = folder("shared");
    let inner = folder.clone();
    let fit = |folder: &Path| {
        Fit::new(point(&[0.5]), adam(), 2)
            .with_progress(false)
            .with_folder(folder)
    };
    let fitted = fit(&folder).on_step(1, move |report| {
        if report.step.index == 0 {
            says(message(fit(&inner).run(bowl)), ["another process"]);
        }
        Ok(true)
    });
    fitted.run(bowl).expect("a fit");
    let again = fit(&folder).run(bowl).expect("the lock is gone");
    assert_eq!(again.resumed, Some(2));
}

/// A fit of an offset through the renderer; one or two seconds.
fn rendered(folder: &Path) -> Fitted<Point> {
    let device = Device::flex();
    let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0]).with_fov_y(40.0);
    let options = RenderOptions::new(16, 16).with_samples(4).with_bounces(1);
    let scene = |at: Tensor<1>| {
        Scene::new()
            .with_object(Object::new(shapes::icosahedron(&device).translated(at)))
            .with_environment([1.0, 1.0, 1.0])
    };
    let still = scene(Tensor::zeros([3], &device));
    let sharp = options.clone().with_samples(64);
    let target = render(&still, &camera, &sharp).expect("a target").radiance;
    let blur = BlurSchedule::decay(0.1, 1e-3, 200).expect("a schedule");
    Fit::new(point(&[0.3, -0.2, 0.1]), adam(), 300)
        .with_progress(false)
        .with_rate(Rate::cosine(0.03))
        .with_blur(blur)
        .with_folder(folder)
        .with_checkpoint_every(3)
        .run(|p: &Point, step: &_| {
            let see = |k| render(&scene(p.at.val()), &camera, &step.options(&options, k));
            let (a, b) = (see(0)?.radiance, see(1)?.radiance);
            Ok(Evaluation::new(loss::mse_unbiased(a, b, target.clone())?))
        })
        .expect("a fit")
}

/// The folder of the process that is killed, which runs the same test.
const VICTIM: &str = "SOFTRAY_FIT_FOLDER";

#[test]
fn killed_at_any_moment_it_ends_the_same() {
    if let Some(folder) = std::env::var_os(VICTIM) {
        let fitted = rendered(Path::new(&folder));
        let text: Vec<String> = place(&fitted.module).iter().map(f64::to_string).collect();
        println!("at {} from {:?}", text.join(" "), fitted.resumed);
        return;
    }
    let (alone, killed) = (folder("alone"), folder("killed"));
    let whole = rendered(&alone);
    let at = place(&whole.module);
    assert!(at[..2].iter().all(|x| x.abs() < 0.05), "{at:?}");
    let victim = || {
        let mut command = again(killed_at_any_moment_it_ends_the_same);
        command
            .env(VICTIM, &killed)
            .stdout(Stdio::piped())
            .stderr(Stdio::null());
        command
    };
    let newest = || {
        let entries = std::fs::read_dir(killed.join("checkpoints"));
        let names = entries.into_iter().flatten().flatten();
        let steps = names.filter_map(|e| e.file_name().to_str()?.parse::<usize>().ok());
        steps.max().unwrap_or(0)
    };
    // Ten kills, some checkpoints apart, at moments between them by a sequence of small discrepancy.
    let mut before_end = 0;
    for k in 0..10 {
        let past = newest() + 3 * (7 * k % 5);
        let mut child = victim().spawn().expect("a process");
        let mut runs = || child.try_wait().expect("a state").is_none();
        while newest() <= past && runs() {
            std::thread::sleep(Duration::from_millis(1));
        }
        let share = (0.5 + 0.618 * k as f64).fract();
        std::thread::sleep(Duration::from_secs_f64(0.03 * share));
        before_end += usize::from(runs());
        child.kill().expect("a kill");
        child.wait().expect("an end");
    }
    assert!(
        before_end >= 3,
        "only {before_end} kills came before the end"
    );
    let output = victim().output().expect("a process");
    let text = String::from_utf8_lossy(&output.stdout);
    let line = text.lines().find_map(|l| l.split("at ").nth(1));
    let (found, resumed) = line
        .and_then(|l| l.split_once(" from "))
        .unwrap_or_else(|| panic!("no result: {text}"));
    let found: Vec<f64> = found
        .split(' ')
        .map(|x| x.parse().expect("a number"))
        .collect();
    assert_eq!(found, at);
    assert!(resumed.starts_with("Some"), "{resumed}");
    let read = |folder: &Path| {
        let path = folder.join("history.csv");
        let text = std::fs::read_to_string(path).expect("a history");
        // All columns but the seconds.
        let cells = |l: &str| {
            let mut cells: Vec<String> = l.split(',').map(String::from).collect();
            cells.remove(5);
            cells
        };
        text.lines().map(cells).collect::<Vec<_>>()
    };
    assert_eq!(read(&killed), read(&alone));
    println!("{before_end} of 10 kills came before the end, then resumed at {resumed}");
}
