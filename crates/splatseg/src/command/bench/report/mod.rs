//! `report.html`: everything on one page that needs no network, no other file and no program but a browser.

mod axes;
mod chart;
mod curves;
mod date;
mod html;
mod strips;

use super::Results;
use super::paper;
use super::size_table::SizeTable;
use super::stage_table::StageTable;
use super::tables::{Origin, Spread, Table, of_scene, over_all_scenes};
use crate::command::score_table::{COLUMNS, SIZE_COLUMNS_EXPLAINED, protocol_name};
use html::{escape, escape_script};
use serde::Serialize;
use splatseg_metrics::Protocol;
use strips::Strip;

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");

const HOW_TO_READ: &str = "<p>Every method gives the objects of an RGB-D video ids that should last. <b>VSQ<sup>k</sup></b> \
    compares true and predicted segment tubes in windows of k frames: with k = 1 ids do not matter, with k = 15 they have \
    to hold. <b>VSQ</b> is the mean over k. <b>STQ</b> looks at the whole video: the geometric mean of <b>AQ</b>, how well \
    ids stay with their objects, and <b>SQ</b>, how well pixels are covered. All are percent; more is better.</p>\
    <p>Protocol <b>paper</b> is what the evaluation code of the method's paper (Opipari et al., Explicit Memory through \
    Online 3D Gaussian Splatting Improves Class-Agnostic Video Segmentation, RA-L 2025, arXiv 2510.23521) computes: any \
    overlap can be a match, and SQ is about half of the recall. Protocol <b>strict</b> is the formulas in print: a match \
    needs an IoU above one half. Over several scenes tubes, tracks and pixels are summed before dividing. ± is the sample \
    standard deviation over seeds. The paper's rows are of <em>other data</em> and stand here for orientation only.</p>";

/// What scripts can read from the page.
#[derive(Serialize)]
struct Embedded<'a> {
    rows: Vec<super::Row<'a>>,
    failures: &'a [super::Failed<'a>],
    strips: &'a [Strip],
}

/// The page.
pub fn page(results: &Results) -> Result<String, String> {
    let strips = strips::of_scenes(results);
    let embedded = Embedded { rows: results.rows(), failures: &results.failed, strips: &strips };
    let data = serde_json::to_string(&embedded).map_err(|error| error.to_string())?;
    let mut body = header(results);
    body.push_str(&failures(results));
    body.push_str(&table(&over_all_scenes(results, results.protocol)));
    body.push_str("<details><summary>How to read this</summary>");
    body.push_str(HOW_TO_READ);
    body.push_str("</details>");
    body.push_str(&folded_table(&over_all_scenes(results, other(results.protocol))));
    body.push_str(&sizes(&SizeTable::new(results, results.protocol)));
    body.push_str(&stage_times(&StageTable::new(results)));
    body.push_str("<h2>Comparison</h2><div class=\"charts\">");
    body.extend(curves::comparison(results));
    body.push_str("</div>");
    for (scene, strip) in strips.iter().enumerate() {
        body.push_str(&scene_section(results, scene, strip));
    }
    body.push_str(&settings(results)?);
    Ok(format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
         <meta name=\"color-scheme\" content=\"light dark\">\
         <link rel=\"icon\" href=\"data:,\">\
         <title>splatseg benchmark</title><style>\n{STYLE}</style></head>\n<body><main>{body}</main>\n\
         <script type=\"application/json\" id=\"benchmark\">{}</script>\n<script>\n{SCRIPT}</script></body></html>\n",
        escape_script(&data)
    ))
}

fn other(protocol: Protocol) -> Protocol {
    match protocol {
        Protocol::Paper => Protocol::Strict,
        Protocol::Strict => Protocol::Paper,
    }
}

fn header(results: &Results) -> String {
    let plan = results.plan;
    let frames: usize = (0..plan.scenes.len())
        .filter_map(|scene| results.finished.iter().find(|finished| finished.scene == scene))
        .map(|finished| finished.result.frames)
        .sum();
    let count = |count: usize, what: &str| format!("{count} {what}{}", if count == 1 { "" } else { "s" });
    format!(
        "<h1>splatseg benchmark</h1><p class=\"facts\">{}, {}, {}, {}; {}; protocol {}; splatseg {}, {}</p>",
        count(plan.scenes.len(), "scene"),
        count(frames, "frame"),
        count(plan.variants.len(), "method"),
        count(plan.seeds.len(), "seed"),
        escape(&plan.parts()),
        protocol_name(results.protocol),
        env!("CARGO_PKG_VERSION"),
        date::today(),
    )
}

fn failures(results: &Results) -> String {
    if results.failed.is_empty() {
        return String::new();
    }
    let items = results.failed.iter().map(|failed| {
        let variant = failed.variant.as_ref().map(|variant| format!(" {variant}")).unwrap_or_default();
        let what = format!("{}, {}{variant}, seed {}: {}", failed.scene, failed.method, failed.seed, failed.error);
        format!("<li>{}</li>", escape(&what))
    });
    let list: String = items.collect();
    format!(
        "<section class=\"failures\"><details><summary>{} results are missing</summary><ul>{list}</ul></details></section>",
        results.failed.len()
    )
}

fn table(table: &Table) -> String {
    format!("<h2>{}</h2>{}", escape(&table.title), table_body(table))
}

fn folded_table(table: &Table) -> String {
    format!("<details><summary>{}</summary>{}</details>", escape(&table.title), table_body(table))
}

fn table_body(table: &Table) -> String {
    let best = best_of_columns(table);
    let mut text = String::from("<div class=\"wide\"><table><thead><tr><th scope=\"col\">method</th>");
    text.extend(COLUMNS.iter().map(|name| format!("<th scope=\"col\">{name}</th>")));
    text.push_str("<th scope=\"col\">frames/s</th></tr></thead><tbody>");
    let mut before = Origin::Measured;
    for row in &table.rows {
        if row.origin == Origin::Paper && before == Origin::Measured {
            text.push_str(&format!("<tr class=\"paper\"><th colspan=\"10\">{}</th></tr>", escape(paper::MARK)));
        }
        before = row.origin;
        let (class, name) = match row.origin {
            Origin::Paper => (" class=\"paper\"", row.label.clone()),
            Origin::Measured => ("", row.name()),
        };
        text.push_str(&format!("<tr{class}><th scope=\"row\">{}</th>", escape(&name)));
        for (value, best) in row.cells.iter().zip(best) {
            let is_best = row.origin == Origin::Measured && value.is_some_and(|value| Some(value.mean) == best);
            let class = if is_best { " class=\"best\"" } else { "" };
            text.push_str(&format!("<td{class}>{}</td>", html_cell(*value)));
        }
        text.push_str(&format!("<td>{}</td></tr>", html_cell(row.speed)));
    }
    text.push_str("</tbody></table></div>");
    text
}

fn sizes(table: &SizeTable) -> String {
    let mut text = format!("<details><summary>{}</summary><p>{SIZE_COLUMNS_EXPLAINED}</p>", escape(&table.title));
    text.push_str("<div class=\"wide\"><table><thead><tr><th scope=\"col\">method</th>");
    text.extend(SizeTable::columns().map(|name| format!("<th scope=\"col\">{name}</th>")));
    text.push_str("</tr></thead><tbody>");
    for row in &table.rows {
        text.push_str(&format!("<tr><th scope=\"row\">{}</th>", escape(&row.method)));
        text.push_str(&format!("<td>{}</td><td>{}</td>", row.class.label(), row.objects));
        text.extend(row.cells.map(|value| format!("<td>{}</td>", html_cell(value))));
        text.push_str("</tr>");
    }
    text.push_str("</tbody></table></div></details>");
    text
}

fn stage_times(table: &StageTable) -> String {
    let mut text = format!("<details><summary>{}</summary>", StageTable::TITLE);
    text.push_str("<div class=\"wide\"><table><thead><tr><th scope=\"col\">method</th>");
    text.extend(table.columns().map(|name| format!("<th scope=\"col\">{}</th>", escape(name))));
    text.push_str("</tr></thead><tbody>");
    for (label, times) in &table.rows {
        text.push_str(&format!("<tr><th scope=\"row\">{}</th>", escape(label)));
        text.extend(times.iter().map(|time| format!("<td>{time:.2}</td>")));
        text.push_str("</tr>");
    }
    text.push_str("</tbody></table></div></details>");
    text
}

/// The mean, and the deviation below it.
fn html_cell(value: Option<Spread>) -> String {
    let Some(Spread { mean, deviation }) = value else {
        return "–".to_owned();
    };
    let deviation = deviation.map(|deviation| format!("<small>± {deviation:.2}</small>")).unwrap_or_default();
    format!("{mean:.2}{deviation}")
}

/// The largest measured mean of each column.
fn best_of_columns(table: &Table) -> [Option<f64>; 8] {
    std::array::from_fn(|column| {
        let measured = table.rows.iter().filter(|row| row.origin == Origin::Measured);
        measured.filter_map(|row| row.cells[column].map(|cell| cell.mean)).max_by(f64::total_cmp)
    })
}

fn scene_section(results: &Results, scene: usize, strip: &Strip) -> String {
    let name = escape(&results.plan.scenes[scene].name);
    if results.finished.iter().all(|finished| finished.scene != scene) {
        return format!("<h2>{name}</h2><p>Nothing was measured.</p>");
    }
    let mut text = format!("<section><h2>{name}</h2>");
    text.push_str(&strip.html(scene));
    let table = of_scene(results, scene, results.protocol);
    text.push_str(&folded_table(&table));
    text.push_str("<div class=\"charts\">");
    text.extend(curves::of_scene(results, scene));
    text.push_str("</div></section>");
    text
}

fn settings(results: &Results) -> Result<String, String> {
    let settings = toml::to_string_pretty(&results.plan.settings).map_err(|error| error.to_string())?;
    Ok(format!(
        "<h2>Settings</h2><details><summary>all settings but method and seed</summary><pre>{}</pre></details>\
         <p class=\"facts\">The rows of results.json are in this page, too: the text of the element \
         <code>#benchmark</code> is JSON.</p>",
        escape(&settings)
    ))
}
