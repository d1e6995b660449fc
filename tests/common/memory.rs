//! Memory of this process.

/// Resident memory, MiB; 0 on systems other than Linux.
pub fn resident() -> f64 {
    mebibytes("VmRSS:")
}

/// Resident memory at its highest, MiB; 0 on systems other than Linux.
pub fn peak() -> f64 {
    mebibytes("VmHWM:")
}

fn mebibytes(field: &str) -> f64 {
    if !cfg!(target_os = "linux") {
        return 0.0;
    }
    let status = std::fs::read_to_string("/proc/self/status").expect("the status of this process");
    let line = status.lines().find(|l| l.starts_with(field));
    let number = line.and_then(|l| l.split_whitespace().nth(1)?.parse::<f64>().ok());
    // Without it no bound of memory would be checked.
    number.expect("a number of KiB") / 1024.0
}
