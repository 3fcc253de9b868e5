//! The settings of one side, from the table of all settings.

use super::state::Side;
use crate::settings::{Description, Settings};
use egui::{RichText, Ui};

/// Shows a row for each setting, pass by pass.
pub fn show(side: &mut Side, ui: &mut Ui) {
    let preset = Side::of(side.method).settings.values();
    let values = side.settings.values();
    let mut pass = "";
    for ((row, (_, value)), (_, default)) in Settings::TABLE.iter().zip(values).zip(preset) {
        if row.pass != pass {
            pass = row.pass;
            ui.add_space(4.0);
            ui.label(RichText::new(pass).small().weak());
        }
        let mut chosen = None;
        ui.horizontal(|ui| {
            let mut name = RichText::new(row.name);
            if value != default {
                name = name.color(egui::Color32::from_rgb(255, 200, 80));
            }
            let label = ui.add_sized([130.0, 18.0], egui::Label::new(name).truncate().sense(egui::Sense::click()));
            if label.on_hover_text(hover(row, &default)).clicked() {
                chosen = Some(default.clone());
            }
            chosen = chosen.take().or(edit(row, &value, ui));
        });
        if let Some(text) = chosen {
            let reset = text == default;
            // The widget has the same range.
            if let Err(error) = side.settings.set(row.name, &text, "the window") {
                tracing::debug!("{error}");
            }
            if reset {
                side.settings.given.retain(|given| *given != row.name); // up to the scene again
            }
        }
    }
}

fn hover(row: &Description, default: &str) -> String {
    let unit = if row.unit.is_empty() { String::new() } else { format!(" {}", row.unit) };
    let ways = row.choices.iter().filter(|(_, meaning)| !meaning.is_empty());
    let ways: String = ways.map(|(name, meaning)| format!("\n{name}: {meaning}")).collect();
    let Description { name, meaning, .. } = row;
    format!("{name}: {meaning}{ways}\n\ndefault {default}{unit}; {}. Click: default", row.allowed())
}

/// Shows a setting. Returns the value that was chosen.
fn edit(row: &Description, value: &str, ui: &mut Ui) -> Option<String> {
    if let [("true", _), ("false", _)] = row.choices {
        let mut on = value == "true";
        return ui.checkbox(&mut on, "").changed().then(|| on.to_string());
    }
    if !row.choices.is_empty() {
        let mut chosen = None;
        egui::ComboBox::from_id_salt(row.name).selected_text(value).width(110.0).show_ui(ui, |ui| {
            for (name, meaning) in row.choices {
                if ui.selectable_label(*name == value, *name).on_hover_text(*meaning).clicked() {
                    chosen = Some((*name).to_owned());
                }
            }
        });
        return chosen;
    }
    let [low, high] = row.range;
    let mut number: f64 = value.parse().unwrap_or(f64::INFINITY);
    let speed = if row.whole { 0.1 } else { (number.abs() * 0.01).clamp(1e-3, 1.0) };
    let drag = egui::DragValue::new(&mut number)
        .range(low..=high)
        .speed(speed)
        .max_decimals(if row.whole { 0 } else { 4 })
        .custom_formatter(|n, _| if n >= 1e6 { "inf".into() } else { n.to_string() })
        .custom_parser(|text| text.trim().parse().ok());
    ui.add(drag).changed().then(|| match (row.whole, number >= 1e6) {
        (true, true) if high >= 1e6 => "inf".to_owned(),
        (true, _) => format!("{}", number.round()),
        (false, _) => number.to_string(),
    })
}
