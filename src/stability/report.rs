//! Writes the report: `stability.json`, a page for people, and the pictures.

use super::{Case, Outcome, metric::shown};
use crate::{
    Error, Result,
    image_file::write::{make_folder, write_bytes},
    settings::Method,
};
use base64::Engine as _;
use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
use serde_json::{Map, Value, json};
use std::{fmt::Write, path::Path};

/// A case and each method's result.
pub struct Row {
    pub case: Case,
    pub results: Vec<(Method, Outcome)>,
}

/// What the cases were measured on.
pub struct Setup {
    pub device: String,
    pub driver: String,
    pub quick: bool,
    /// Settings that differ from the methods' own, as `key=value`.
    pub set: Vec<String>,
}

impl Row {
    /// Returns the case with each method whose value is beyond the limit.
    pub fn beyond(&self) -> Vec<String> {
        let failing = self.results.iter().filter(|(_, outcome)| !self.passes(outcome));
        failing.map(|(method, _)| format!("{} ({})", self.case.name, method.name())).collect()
    }

    /// Says whether a method's value is within the limit.
    pub fn passes(&self, outcome: &Outcome) -> bool {
        outcome.value <= self.case.limit
    }

    fn json(&self) -> Value {
        let result = |(method, outcome): &(Method, Outcome)| {
            (method.name(), json!({ "value": outcome.value, "pass": self.passes(outcome) }))
        };
        let results: Map<String, Value> = self.results.iter().map(result).collect();
        let case = &self.case;
        json!({ "name": case.name, "asks": case.asks, "metric": case.metric, "unit": case.unit, "limit": case.limit,
            "reason": case.reason, "results": results })
    }

    /// Returns a line for the terminal.
    pub fn line(&self) -> String {
        let mut line = format!("{:<22}", self.case.name);
        for (method, outcome) in &self.results {
            let verdict = if self.passes(outcome) { "pass" } else { "FAIL" };
            let _ = write!(line, "{:>6} {:>9} {verdict}", method.name(), number(outcome.value));
        }
        let _ = write!(line, "   limit {}{}", number(self.case.limit), self.case.unit);
        line
    }
}

/// Writes a value with four digits, or says that the picture holds NaN.
pub fn number(value: f64) -> String {
    match value {
        v if v >= super::metric::NOT_FINITE => "not finite".to_owned(),
        0.0 => "0".to_owned(),
        v if v >= 100.0 => format!("{v:.0}"),
        v if v >= 1.0 => format!("{v:.2}"),
        v => format!("{v:.4}"),
    }
}

/// Places worst frame, truth and difference side by side. Returns width, height and 8-bit sRGB. The
/// difference is of displayed values, grey ±½.
pub fn triptych(outcome: &Outcome) -> ([u32; 2], Vec<u8>) {
    let [width, height] = outcome.size;
    let zoom = (240 / width.max(1)).clamp(1, 16);
    let gap = zoom.max(4);
    let whole = [3 * width * zoom + 2 * gap, height * zoom];
    let mut codes = vec![255u8; (whole[0] * whole[1] * 3) as usize];
    for y in 0..whole[1] {
        for part in 0..3 {
            for x in 0..width * zoom {
                let i = ((y / zoom) * width + x / zoom) as usize;
                let at = ((y * whole[0] + part * (width * zoom + gap) + x) * 3) as usize;
                for c in 0..3 {
                    let (test, truth) =
                        (shown(outcome.worst[i][c], outcome.exposure), shown(outcome.truth[i][c], outcome.exposure));
                    let value = match part {
                        0 => test,
                        1 => truth,
                        _ => (0.5 + 2.0 * (test - truth)).clamp(0.0, 1.0),
                    };
                    codes[at + c] = (value * 255.0 + 0.5) as u8;
                }
            }
        }
    }
    (whole, codes)
}

fn png(outcome: &Outcome) -> Result<Vec<u8>> {
    let (size, codes) = triptych(outcome);
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes)
        .write_image(&codes, size[0], size[1], ExtendedColorType::Rgb8)
        .map_err(|error| Error::Internal(format!("a picture of the report: {error}")))?;
    Ok(bytes)
}

/// Writes `stability.json`, `stability.html` and `CASE_METHOD.png` into a folder, which is made if it does
/// not exist.
///
/// # Errors
/// Fails if the folder cannot be written.
pub fn write(folder: &Path, rows: &[Row], setup: &Setup) -> Result<()> {
    make_folder(folder)?;
    let mut body = String::new();
    for row in rows {
        let case = &row.case;
        let _ = write!(
            body,
            "<section id=\"{}\"><h2>{}</h2><p>{}</p><p class=\"fine\">Measured: {}. Limit {}{}: {}.</p>\n<div class=\"methods\">",
            case.name,
            case.name.replace('_', " "),
            case.asks,
            case.metric,
            number(case.limit),
            case.unit,
            case.reason
        );
        for (method, outcome) in &row.results {
            let bytes = png(outcome)?;
            write_bytes(&folder.join(format!("{}_{}.png", case.name, method.name())), &bytes)?;
            let (class, verdict) = if row.passes(outcome) { ("pass", "pass") } else { ("fail", "fail") };
            let _ = writeln!(
                body,
                "<figure><figcaption><b>{}</b> {}{} <span class=\"{class}\">{verdict}</span></figcaption>\
                 <img alt=\"{} of {}: worst frame, truth, difference\" src=\"data:image/png;base64,{}\"></figure>",
                method.name(),
                number(outcome.value),
                case.unit,
                case.name,
                method.name(),
                base64::engine::general_purpose::STANDARD.encode(&bytes)
            );
        }
        body.push_str("</div></section>\n");
    }
    let json = json!({ "device": setup.device, "driver": setup.driver, "quick": setup.quick, "set": setup.set,
        "cases": rows.iter().map(Row::json).collect::<Vec<_>>() });
    let json = serde_json::to_string_pretty(&json).map_err(|error| Error::Internal(error.to_string()))?;
    write_bytes(&folder.join("stability.html"), page(&body, rows, setup).as_bytes())?;
    write_bytes(&folder.join("stability.json"), json.as_bytes())
}

fn page(body: &str, rows: &[Row], setup: &Setup) -> String {
    let mut table = String::from("<table><tr><th>case</th>");
    for (method, _) in rows.first().iter().flat_map(|row| &row.results) {
        let _ = write!(table, "<th>{}</th>", method.name());
    }
    table.push_str("<th>limit</th></tr>\n");
    for row in rows {
        let _ = write!(table, "<tr><td><a href=\"#{0}\">{1}</a></td>", row.case.name, row.case.name.replace('_', " "));
        for (_, outcome) in &row.results {
            let class = if row.passes(outcome) { "pass" } else { "fail" };
            let _ = write!(table, "<td class=\"{class}\">{}</td>", number(outcome.value));
        }
        let _ = writeln!(table, "<td>{}{}</td></tr>", number(row.case.limit), row.case.unit);
    }
    table.push_str("</table>");
    format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>iprt: where it fails</title><style>\
         body{{font:15px/1.5 sans-serif;max-width:82em;margin:2em auto;padding:0 1em;color:#222}}\
         table{{border-collapse:collapse}}td,th{{padding:.2em .9em;border-bottom:1px solid #ddd;text-align:right}}\
         td:first-child,th:first-child{{text-align:left}}.pass{{color:#17692b}}.fail{{color:#b3261e;font-weight:bold}}\
         .fine{{color:#555}}.methods{{display:flex;flex-wrap:wrap;gap:1em}}figure{{margin:0}}\
         img{{width:26em;max-width:100%;image-rendering:pixelated;border:1px solid #ccc}}</style>\
         <h1>Where methods of this kind fail</h1><p>Each case is a short sequence. One number says how far a method is from the \
         truth, or from what must not change; it passes up to the limit. The pictures are the worst frame, what it should be, and \
         the difference of displayed values, doubled, about grey. <b>ibl</b> looks light up by direction alone, <b>paper</b> is \
         the published method, <b>iprt</b> the default here.</p><p class=\"fine\">{} ({}){}{}</p>\n{table}\n{body}</html>\n",
        setup.device,
        setup.driver,
        if setup.quick { ", quick: small pictures, few frames" } else { "" },
        setup.set.iter().map(|pair| format!(", {pair}")).collect::<String>(),
    )
}
