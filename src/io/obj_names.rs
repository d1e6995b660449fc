//! Names of files in statements of OBJ and MTL files.

use std::path::{Path, PathBuf};

/// The first word of a line and the rest, trimmed.
pub(super) fn keyword(line: &str) -> (&str, &str) {
    let line = line.trim();
    let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
    (keyword, rest.trim())
}

/// The files of an `mtllib` line: one name that may have spaces, or several names.
pub(super) fn libraries(folder: &Path, rest: &str) -> Vec<PathBuf> {
    let whole = resolve(&[folder], rest);
    if whole.is_file() || rest.split_whitespace().count() < 2 {
        return vec![whole];
    }
    rest.split_whitespace()
        .map(|name| resolve(&[folder], name))
        .collect()
}

/// The file of that name in the first folder that has it, else what it would be in the first one.
pub(super) fn resolve(folders: &[&Path], name: &str) -> PathBuf {
    // Windows exporters write backslashes.
    let slashed = name.replace('\\', "/");
    let mut candidates = folders
        .iter()
        .flat_map(|f| [f.join(name), f.join(&slashed)]);
    let first = candidates.clone().next().unwrap_or_else(|| name.into());
    candidates.find(|c| c.is_file()).unwrap_or(first)
}

/// The file name of a texture statement after its options, like `-s 2 2 1 -clamp on wood.png`, and
/// the options with their first words.
pub(super) fn texture_name(mut rest: &str) -> (&str, Vec<[&str; 2]>) {
    let mut options = Vec::new();
    while rest.starts_with('-') {
        let (option, mut after) = keyword(rest);
        options.push([option, keyword(after).0]);
        let (least, most) = match option {
            "-o" | "-s" | "-t" => (1, 3),
            "-mm" => (2, 2),
            _ => (1, 1),
        };
        for i in 0..most {
            let (word, next) = keyword(after);
            if i >= least && word.parse::<f64>().is_err() {
                break;
            }
            after = next;
        }
        rest = after;
    }
    (rest, options)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_of_textures() {
        assert_eq!(texture_name("oak wood.png"), ("oak wood.png", Vec::new()));
        let (name, options) = texture_name("-s 2 2 1 -clamp on -bm 1 oak wood.png");
        assert_eq!(name, "oak wood.png");
        assert_eq!(options, [["-s", "2"], ["-clamp", "on"], ["-bm", "1"]]);
    }
}
