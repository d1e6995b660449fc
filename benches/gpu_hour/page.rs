//! What was measured, to read.

use std::fmt::Write;

use serde_json::Value;

/// One step in a line.
pub fn line(row: &Value) -> String {
    let text = |key: &str| row[key].to_string().replace('"', "");
    let number = |key: &str| row[key].as_f64().unwrap_or(f64::NAN);
    format!(
        "| {} | {} | {} + {} | {}² × {} | {:.1} | {:.1} | {:.1} | {:.1} | {:.2} | {:.2} | {} | {} | {:.2} | {} |",
        text("name"),
        text("scenes"),
        text("faces that move"),
        text("faces that stand"),
        text("size"),
        text("samples"),
        number("first, s"),
        number("image alone, ms"),
        number("step, ms"),
        number("host of a timed step, ms"),
        number("million paths of images a second"),
        number("million paths of steps a second"),
        text("launches"),
        text("uploads"),
        1e-6 * number("bytes up"),
        text("read-backs"),
    )
}

/// All of it.
pub fn page(report: &Value) -> String {
    let mut page = format!(
        "# A GPU\n\nDevice `{}`: {}; {} s in all.\n\n| step | scenes | faces (move + stand) | image | first, s | image, ms \
         | step, ms | host of a timed step, ms | M paths/s of images | of steps | launches | uploads | MB up | read-backs |\n|{}\n",
        report["device"].as_str().unwrap_or("?"),
        report["adapter"].as_str().unwrap_or("no adapter is known"),
        report["seconds"],
        "---|".repeat(14),
    );
    let steps = report["steps"].as_array().cloned().unwrap_or_default();
    for row in &steps {
        let _ = writeln!(page, "{}", line(row));
    }
    page.push_str("\n## Stages of a step, ms\nThe host waits before and after each kernel here, so that all together takes longer than a step.\n");
    for row in &steps {
        let _ = writeln!(
            page,
            "\n{} ({} scenes, {} + {} faces):\n\n| stage | times | ms |\n|---|---|---|",
            row["name"].as_str().unwrap_or("?"),
            row["scenes"],
            row["faces that move"],
            row["faces that stand"],
        );
        for stage in row["stages"].as_array().into_iter().flatten() {
            let name = stage["name"].as_str().unwrap_or("?");
            let ms = stage["ms"].as_f64().unwrap_or(f64::NAN);
            let _ = writeln!(page, "| {name} | {} | {ms:.2} |", stage["count"]);
        }
    }
    let _ = writeln!(
        page,
        "\n## Apart from the host\nDifferences over the largest number, by quantiles: `{}`.",
        report["apart"]
    );
    page
}
