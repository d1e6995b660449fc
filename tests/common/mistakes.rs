//! Small scenes to make mistakes with, and checks of the errors and warnings that these cause.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Mutex, Once};
use std::thread::ThreadId;

use burn::tensor::{Device, Tensor};
use softray::Result;
use softray::prelude::*;

/// Mistakes with the messages that are expected of them. The test fails at the end with a list of all that differ.
#[derive(Default)]
pub struct Mistakes {
    failures: Vec<String>,
}

impl Mistakes {
    /// That a mistake is an error whose message has these parts.
    pub fn expect<T>(&mut self, mistake: &str, parts: &[&str], f: impl FnOnce() -> Result<T>) {
        self.check_result(
            mistake,
            parts,
            catch_unwind(AssertUnwindSafe(|| f().map(drop))),
        );
    }

    fn check_result(
        &mut self,
        mistake: &str,
        parts: &[&str],
        result: std::thread::Result<Result<()>>,
    ) {
        let message = match result {
            Ok(Ok(())) => "NO ERROR".to_owned(),
            Ok(Err(error)) => {
                let (shown, debug) = (error.to_string(), format!("{error:?}"));
                if shown != debug {
                    self.failures.push(format!("{mistake}: Debug is {debug}"));
                }
                shown
            }
            Err(_) => "PANIC".to_owned(),
        };
        println!("{mistake:44} {message}");
        self.check(mistake, parts, &message);
    }

    /// That a mistake is a panic, as its documentation says, whose message has these parts.
    pub fn expect_panic<T>(&mut self, mistake: &str, parts: &[&str], f: impl FnOnce() -> T) {
        let message = match catch_unwind(AssertUnwindSafe(f)) {
            Ok(_) => "NO PANIC".to_owned(),
            Err(payload) => match payload.downcast::<String>() {
                Ok(text) => *text,
                Err(payload) => payload
                    .downcast::<&str>()
                    .map_or("?".to_owned(), |s| s.to_string()),
            },
        };
        println!("{mistake:44} (panic) {message}");
        self.check(mistake, parts, &message);
    }

    fn check(&mut self, mistake: &str, parts: &[&str], message: &str) {
        for part in parts.iter().filter(|p| !message.contains(**p)) {
            self.failures
                .push(format!("{mistake}: no {part:?} in {message:?}"));
        }
    }
}

impl Drop for Mistakes {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            assert!(self.failures.is_empty(), "\n{}", self.failures.join("\n"));
        }
    }
}

pub fn flex() -> Device {
    Device::flex()
}

pub fn row<const N: usize>(values: [f32; N]) -> Tensor<1> {
    Tensor::from_floats(values, &flex())
}

pub fn ball() -> Object {
    Object::new(shapes::icosahedron(&flex())).with_name("ball")
}

pub fn lit(object: Object) -> Scene {
    Scene::new().with_object(object).with_environment([1.0; 3])
}

pub fn camera() -> Camera {
    Camera::look_at([0.3, 0.4, 4.0], [0.0; 3]).with_fov_y(40.0)
}

pub fn small() -> RenderOptions {
    RenderOptions::new(4, 4).with_samples(1).with_bounces(0)
}

pub fn see(object: Object) -> Result<Image> {
    render(&lit(object), &camera(), &small())
}

/// What is logged, by thread.
struct Log(Mutex<Vec<(ThreadId, String)>>);

static LOG: Log = Log(Mutex::new(Vec::new()));

impl log::Log for Log {
    fn enabled(&self, _: &log::Metadata) -> bool {
        true
    }

    fn log(&self, record: &log::Record) {
        if record.level() <= log::Level::Warn {
            let mut log = self.0.lock().expect("a log");
            log.push((std::thread::current().id(), record.args().to_string()));
        }
    }

    fn flush(&self) {}
}

/// The warnings that a function logs on this thread.
pub fn warnings<T>(f: impl FnOnce() -> T) -> Vec<String> {
    static SET: Once = Once::new();
    SET.call_once(|| {
        log::set_logger(&LOG).expect("no other logger");
        log::set_max_level(log::LevelFilter::Warn);
    });
    let thread = std::thread::current().id();
    LOG.0.lock().expect("a log").retain(|(id, _)| *id != thread);
    f();
    let log = LOG.0.lock().expect("a log");
    let of_thread = log.iter().filter(|(id, _)| *id == thread);
    of_thread.map(|(_, message)| message.clone()).collect()
}
