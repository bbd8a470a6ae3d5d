//! The panel: one page, embedded with all its files.

use axum::http::{HeaderName, StatusCode, header};
use axum::response::{IntoResponse, Response};

use super::not_found;
use crate::http::error::Name;

/// A file of the panel.
struct File {
    name: &'static str,
    content_type: &'static str,
    content: &'static str,
}

const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
const SVG: &str = "image/svg+xml";

macro_rules! file {
    ($name:literal, $content_type:expr) => {
        File { name: $name, content_type: $content_type, content: include_str!(concat!("../../../panel/", $name)) }
    };
}

const PAGE: File = file!("index.html", HTML);

/// The files of the page, at `/panel/NAME`.
const FILES: [File; 18] = [
    file!("panel.css", CSS),
    file!("icon.svg", SVG),
    file!("api.js", SCRIPT),
    file!("bus.js", SCRIPT),
    file!("clock.js", SCRIPT),
    file!("communication.js", SCRIPT),
    file!("device.js", SCRIPT),
    file!("dial.js", SCRIPT),
    file!("dom.js", SCRIPT),
    file!("faults.js", SCRIPT),
    file!("gauge.js", SCRIPT),
    file!("main.js", SCRIPT),
    file!("notice.js", SCRIPT),
    file!("paint.js", SCRIPT),
    file!("plant.js", SCRIPT),
    file!("plot.js", SCRIPT),
    file!("trace.js", SCRIPT),
    file!("words.js", SCRIPT),
];

/// The content security policy: the page loads and reaches only this server, and has no inline script or style.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// The headers of every file; without caching, so that the browser has the current files after an update.
const HEADERS: [(HeaderName, &str); 4] = [
    (header::CONTENT_SECURITY_POLICY, POLICY),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::CACHE_CONTROL, "no-cache"),
];

/// Serves the panel page.
pub(super) async fn page() -> Response {
    PAGE.into_response()
}

/// Serves a file of the panel.
pub(super) async fn file(Name(name): Name) -> Response {
    match FILES.iter().find(|file| file.name == name) {
        Some(file) => file.into_response(),
        None => not_found().await.into_response(),
    }
}

impl IntoResponse for &File {
    fn into_response(self) -> Response {
        (StatusCode::OK, HEADERS, [(header::CONTENT_TYPE, self.content_type)], self.content).into_response()
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::fs;

    use super::*;

    /// The size limit of the panel, in bytes.
    const BUDGET: usize = 61_000;

    #[test]
    fn the_panel_is_small() {
        let size = FILES.iter().chain([&PAGE]).map(|file| file.content.len()).sum::<usize>();
        assert!(size < BUDGET, "{size} bytes");
    }

    #[test]
    fn every_file_of_the_panel_is_served() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/panel");
        let written = fs::read_dir(folder).expect("the panel").map(|file| {
            let name = file.expect("a file").file_name();
            name.into_string().expect("text")
        });
        let served: BTreeSet<String> = FILES.iter().chain([&PAGE]).map(|file| file.name.to_owned()).collect();
        assert_eq!(written.collect::<BTreeSet<_>>(), served);
    }

    /// The page reaches no other server, has no inline script, and cannot be framed.
    #[test]
    fn every_file_has_the_policy() {
        for file in FILES.iter().chain([&PAGE]) {
            let answer = file.into_response();
            let header = |name| answer.headers().get(name).and_then(|value| value.to_str().ok());
            assert_eq!(header("content-type"), Some(file.content_type));
            assert_eq!(header("x-content-type-options"), Some("nosniff"));
            let policy = header("content-security-policy").expect("a policy");
            for rule in ["default-src 'none'", "script-src 'self';", "style-src 'self';", "frame-ancestors 'none'"] {
                assert!(policy.contains(rule), "{}: {policy}", file.name);
            }
        }
    }

    #[test]
    fn the_panel_asks_for_nothing_but_its_files() {
        for file in FILES.iter().chain([&PAGE]) {
            for remote in ["https://", "http://", "//cdn", "@import", "style=\"", "innerHTML", "eval("] {
                let namespace = "http://www.w3.org/2000/svg";
                assert!(!file.content.replace(namespace, "").contains(remote), "{}: {remote}", file.name);
            }
        }
    }
}
