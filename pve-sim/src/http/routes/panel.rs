//! The panel: one page, embedded with all its files.

use axum::http::{HeaderName, header};
use axum::response::{IntoResponse, Response};

use super::not_found;
use crate::http::error::Name;

/// A file of the panel: its name and its content.
type File = (&'static str, &'static str);

macro_rules! files {
    ($($name:literal)*) => { [$(($name, include_str!(concat!("../../../panel/", $name))),)*] };
}

const PAGE: File = files!("index.html")[0];

/// The files of the page, at `/panel/NAME`.
const FILES: [File; 18] = files! {
    "panel.css" "icon.svg" "api.js" "bus.js" "clock.js" "communication.js" "device.js" "dial.js" "dom.js" "faults.js"
    "gauge.js" "main.js" "notice.js" "paint.js" "plant.js" "plot.js" "trace.js" "words.js"
};

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

pub(super) async fn page() -> Response {
    response(PAGE)
}

pub(super) async fn file(Name(name): Name) -> Response {
    match FILES.iter().find(|file| file.0 == name) {
        Some(file) => response(*file),
        None => not_found().await.into_response(),
    }
}

fn response((name, content): File) -> Response {
    let content_type = match name.rsplit_once('.').map_or("", |(_, ending)| ending) {
        "css" => "text/css; charset=utf-8",
        "js" => "text/javascript; charset=utf-8",
        "svg" => "image/svg+xml",
        _ => "text/html; charset=utf-8",
    };
    (HEADERS, [(header::CONTENT_TYPE, content_type)], content).into_response()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::fs;

    use super::*;

    /// The size limit of the panel, in bytes.
    const BUDGET: usize = 63_000;

    #[test]
    fn the_panel_is_small() {
        let size = FILES.iter().chain([&PAGE]).map(|(_, content)| content.len()).sum::<usize>();
        assert!(size < BUDGET, "{size} bytes");
    }

    #[test]
    fn every_file_of_the_panel_is_served() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/panel");
        let written = fs::read_dir(folder).expect("the panel").map(|file| {
            let name = file.expect("a file").file_name();
            name.into_string().expect("text")
        });
        let served: BTreeSet<String> = FILES.iter().chain([&PAGE]).map(|(name, _)| (*name).to_owned()).collect();
        assert_eq!(written.collect::<BTreeSet<_>>(), served);
    }

    /// The page reaches no other server, has no inline script, and cannot be framed.
    #[test]
    fn every_file_has_the_policy() {
        for file in FILES.iter().chain([&PAGE]) {
            let answer = response(*file);
            let header = |name| answer.headers().get(name).and_then(|value| value.to_str().ok());
            assert!(header("content-type").is_some_and(|kind| kind.starts_with("text/") || kind == "image/svg+xml"));
            assert_eq!(header("x-content-type-options"), Some("nosniff"));
            let policy = header("content-security-policy").expect("a policy");
            for rule in ["default-src 'none'", "script-src 'self';", "style-src 'self';", "frame-ancestors 'none'"] {
                assert!(policy.contains(rule), "{}: {policy}", file.0);
            }
        }
    }

    #[test]
    fn the_panel_asks_for_nothing_but_its_files() {
        for file in FILES.iter().chain([&PAGE]) {
            for remote in ["https://", "http://", "//cdn", "@import", "style=\"", "innerHTML", "eval("] {
                let namespace = "http://www.w3.org/2000/svg";
                assert!(!file.1.replace(namespace, "").contains(remote), "{}: {remote}", file.0);
            }
        }
    }
}
