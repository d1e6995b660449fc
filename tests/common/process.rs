//! Processes of a test's own, for what all tests of a process share: memory, counters, the environment.

use std::path::Path;
use std::process::Command;

/// This program with this test alone.
pub fn again<T>(_test: T) -> Command {
    let path = std::any::type_name::<T>();
    let (_, name) = path.split_once("::").expect("a function of this program");
    let mut command = Command::new(std::env::current_exe().expect("a program"));
    command.args(["--exact", name, "--nocapture"]);
    command
}

/// Whether this process runs this test alone. Otherwise one is started that does, and has to pass.
#[track_caller]
pub fn alone<T>(test: T) -> bool {
    alone_with(test, &[])
}

/// The same with variables of the environment.
#[track_caller]
pub fn alone_with<T>(test: T, variables: &[(&str, &Path)]) -> bool {
    const ALONE: &str = "SOFTRAY_ALONE";
    if std::env::var_os(ALONE).is_some() {
        return true;
    }
    let mut own = again(test);
    let own = own.env(ALONE, "1").envs(variables.iter().copied());
    let output = own.output().expect("a process");
    let said = [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text));
    println!("{}{}", said[0], said[1]);
    assert!(output.status.success() && said[0].contains("1 passed"));
    false
}
