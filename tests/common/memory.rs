//! Memory of this process.

/// Resident memory, MiB; 0 where the system does not tell.
pub fn resident() -> f64 {
    mebibytes("VmRSS:")
}

/// Resident memory at its highest, MiB; 0 where the system does not tell.
pub fn peak() -> f64 {
    mebibytes("VmHWM:")
}

fn mebibytes(field: &str) -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|l| l.starts_with(field));
    let number = line.and_then(|l| l.split_whitespace().nth(1)?.parse::<f64>().ok());
    number.unwrap_or(0.0) / 1024.0
}
