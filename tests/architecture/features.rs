//! Tests that need a feature: those that CI runs with it.

use std::fs;

use crate::files::{root, rust_files};

/// A subject of a test program, which is a folder of tests/: its file, and those in its folder.
#[derive(Debug, Default, PartialEq)]
struct Subject {
    program: String,
    module: String,
    text: String,
}

impl Subject {
    /// Whether a command runs its tests: all of the program's, or by a filter that begins with its module.
    fn is_run_by(&self, command: &str) -> bool {
        let (programs, filters) = command.split_once(" -- ").unwrap_or((command, ""));
        let words: Vec<&str> = programs.split_whitespace().collect();
        let named = words.windows(2).any(|w| w == ["--test", &self.program]);
        let filters = filters.split_whitespace().filter(|f| !f.starts_with('-'));
        let mut modules = filters.map(|filter| filter.split("::").next()).peekable();
        named && (modules.peek().is_none() || modules.any(|m| m == Some(&self.module)))
    }
}

/// The text of a file of the repository, with the variable of `.ci/run` for a command that runs tests written out.
fn text(path: &str) -> String {
    let text = fs::read_to_string(root().join(path)).expect(path);
    text.replace("\"${all[@]}\"", &format!("cargo test {FEATURES}"))
}

/// All subjects that have tests.
fn subjects() -> Vec<Subject> {
    let mut subjects: Vec<Subject> = Vec::new();
    for (path, text) in rust_files("tests") {
        let path = path.with_extension("");
        let mut names = path
            .iter()
            .skip(1)
            .map(|n| n.to_string_lossy().into_owned());
        let [program, module] = [names.next(), names.next()].map(Option::unwrap_or_default);
        let same = |s: &&mut Subject| s.program == program && s.module == module;
        match subjects.iter_mut().find(same) {
            Some(subject) => subject.text += &text,
            None => subjects.push(Subject {
                program,
                module,
                text,
            }),
        }
    }
    subjects.retain(|s| s.text.contains("#[test]") && s.program != "architecture");
    subjects
}

/// The commands of a text that run tests with a feature, each on one line, without where their output goes.
fn commands_with(feature: &str, text: &str) -> Vec<String> {
    let whole = text.replace("\\\n", " ");
    let has = |line: &&str| line.contains("cargo test") && line.contains(feature);
    let commands = whole.lines().filter(has);
    let before_output = |line: &str| line.split(" 2>").next().map(str::to_owned);
    commands.filter_map(before_output).collect()
}

/// All that needs more than the default features shares one build.
const FEATURES: &str = "--features vulkan,ndarray,train,remote-server";

/// A test of a feature that no command builds would never run. Commands that a slow machine leaves out count.
pub fn not_run() -> Vec<String> {
    let on_gpus = |s: &Subject| s.program == "gpu";
    // `cpu_devices` are more with ndarray.
    let parts = [
        r#"feature = "gpu""#,
        r#"feature = "wgpu""#,
        r#"feature = "ndarray""#,
        "cpu_devices",
    ];
    let needs = |s: &Subject| {
        let part = parts.iter().any(|part| s.text.contains(part));
        part || on_gpus(s) || s.program == "remote"
    };
    let subjects = subjects();
    let missing = |file: &str, feature: &str, needs: &dyn Fn(&Subject) -> bool| -> Vec<String> {
        let commands = commands_with(feature, &text(file));
        let is_run = |s: &Subject| commands.iter().any(|command| s.is_run_by(command));
        let missing = subjects.iter().filter(|s| needs(s) && !is_run(s));
        let show = |s: &Subject| format!("{file}: {}::{}", s.program, s.module);
        let missing = missing.map(show);
        missing.collect()
    };
    let mut all = missing(".ci/run", FEATURES, &needs);
    all.extend(missing("README.md", "--features vulkan", &on_gpus));
    let units = commands_with(FEATURES, &text(".ci/run"));
    if !units.iter().any(|command| command.contains(" --lib ")) {
        all.push(".ci/run: --lib".to_owned());
    }
    all
}

/// Filters of commands that no test has: such a command passes without one.
pub fn without_tests() -> Vec<String> {
    let (subjects, commands) = (subjects(), commands_with("--features", &text(".ci/run")));
    let is_of_a_test = |filter: &&str| {
        let [module, name] =
            [filter.split("::").next(), filter.rsplit("::").next()].map(Option::unwrap_or_default);
        let test = format!("fn {name}");
        let between = filter.matches("::").count() - 1;
        let between = filter.split("::").skip(1).take(between);
        let between: Vec<String> = between.map(|part| format!("mod {part}")).collect();
        let all = |text: &str| {
            between
                .iter()
                .chain([&test])
                .all(|part| text.contains(part))
        };
        let has = |s: &Subject| s.module == module && all(&s.text);
        subjects.iter().any(has)
    };
    let filters = commands
        .iter()
        .filter_map(|command| command.split_once(" -- "));
    let filters = filters.flat_map(|(_, filters)| filters.split_whitespace());
    let strange = filters.filter(|f| f.contains("::") && !is_of_a_test(f));
    strange.map(|filter| format!(".ci/run: {filter}")).collect()
}

#[test]
fn subjects_and_commands_are_found() {
    let found = subjects();
    let of = |program: &str, module: &str| {
        let is = |s: &&Subject| s.program == program && s.module == module;
        found.iter().find(is).expect("a subject")
    };
    let (kernels, losses) = (of("gpu", "kernels"), of("fit", "losses"));
    // A part in the subject's folder is the subject's.
    assert!(
        of("render", "mistakes").text.contains("mod ranges")
            && !found.contains(&Subject::default())
    );
    let all = "cargo test --features a --test gpu --test fit -- --nocapture";
    assert!(kernels.is_run_by(all) && losses.is_run_by(all));
    let one = "cargo test --test gpu --test fit -- losses::a_name";
    assert!(!kernels.is_run_by(one) && losses.is_run_by(one));
    assert!(!losses.is_run_by("cargo test --test gpu -- losses::"));
    assert!(!kernels.is_run_by("cargo test --features a --lib"));
}
