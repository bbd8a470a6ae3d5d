//! The guard of the control interface: refuses requests for a host name that another site has bound to this address
//! (DNS rebinding), cross-site requests, and queries and bodies that a call would ignore.

use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;

use axum::Extension;
use axum::body::HttpBody as _;
use axum::extract::Request;
use axum::http::uri::Authority;
use axum::http::{HeaderMap, HeaderName, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::connection::Connection;
use super::error::Failure;

const FETCH_SITE: HeaderName = HeaderName::from_static("sec-fetch-site");

const FOREIGN: &str = "cross-site requests are refused";

/// Passes an allowed request on; answers any other request with status 403.
pub(super) async fn guard(Extension(connection): Extension<Arc<Connection>>, request: Request, next: Next) -> Response {
    match check(&request, connection.local()) {
        Ok(()) => next.run(request).await,
        Err(refusal) => Failure::Request(StatusCode::FORBIDDEN, refusal).into_response(),
    }
}

/// Passes on a request without a query; for calls without parameters.
pub(super) async fn without_query(request: Request, next: Next) -> Response {
    match request.uri().query().filter(|query| !query.is_empty()) {
        Some(query) => Failure::bad_request(format!("unknown query '{query}'; this call has none")).into_response(),
        None => next.run(request).await,
    }
}

/// Passes on a request without a body, or with a method that has one.
pub(super) async fn without_body(request: Request, next: Next) -> Response {
    let reads = matches!(*request.method(), Method::POST | Method::PATCH);
    match reads || request.body().is_end_stream() {
        true => next.run(request).await,
        false => Failure::bad_request("this call has no body").into_response(),
    }
}

fn check(request: &Request, local: SocketAddr) -> Result<(), String> {
    let headers = request.headers();
    let host = only(headers, &header::HOST)?.ok_or("the Host header is missing")?;
    let target = request.uri().authority().map(Authority::as_str);
    if !is_own(host, local.ip()) || target.is_some_and(|target| !is_own(target, local.ip())) {
        return Err("the Host is neither loopback nor the address of this server".to_owned());
    }
    if let Some(origin) = only(headers, &header::ORIGIN)?
        && origin.strip_prefix("http://") != Some(host)
    {
        return Err(FOREIGN.to_owned());
    }
    match only(headers, &FETCH_SITE)? {
        Some("cross-site" | "same-site") if !request.method().is_safe() => Err(FOREIGN.to_owned()),
        _ => Ok(()),
    }
}

/// Returns the value of a header; `None` if the header is missing, and an error if it is duplicated or not printable
/// ASCII.
fn only<'a>(headers: &'a HeaderMap, name: &HeaderName) -> Result<Option<&'a str>, String> {
    let mut values = headers.get_all(name).iter();
    match (values.next(), values.next()) {
        (None, _) => Ok(None),
        (Some(value), None) => value.to_str().map(Some).map_err(|_| format!("header {name} is not printable ASCII")),
        (Some(_), Some(_)) => Err(format!("duplicate header {name}")),
    }
}

/// Returns whether a host, with or without a port, is loopback or the local address of the connection. Returns `false`
/// for a host with further parts, such as a user or an address zone.
fn is_own(host: &str, local: IpAddr) -> bool {
    let name = match host.rsplit_once(':') {
        // A colon inside an IPv6 address.
        Some((_, rest)) if rest.ends_with(']') => host,
        Some((name, port)) if port.bytes().all(|digit| digit.is_ascii_digit()) && port.parse::<u16>().is_ok() => name,
        Some(_) => return false,
        None => host,
    };
    let in_brackets = name.strip_prefix('[').and_then(|name| name.strip_suffix(']'));
    let ip = match in_brackets {
        Some(name) => name.parse().map(IpAddr::V6),
        None => name.parse().map(IpAddr::V4),
    };
    match ip {
        Ok(ip) => ip.is_loopback() || ip.to_canonical() == local.to_canonical(),
        Err(_) => name.eq_ignore_ascii_case("localhost"),
    }
}

#[cfg(test)]
mod tests {
    use axum::body::Body;
    use axum::http::Uri;

    use super::*;

    const LOCAL: &str = "192.168.7.5:8408";

    fn checked(method: &str, headers: &[(&str, &str)]) -> bool {
        let local = LOCAL.parse().expect("an address");
        let request = headers
            .iter()
            .fold(Request::builder().method(method).uri("/"), |request, (name, value)| request.header(*name, *value));
        check(&request.body(Body::empty()).expect("a request"), local).is_ok()
    }

    #[test]
    fn hosts() {
        for host in
            ["127.0.0.1:8408", "127.0.0.1", "localhost", "LocalHost:1", "[::1]:8408", "[::1]", "192.168.7.5:8408"]
        {
            assert!(checked("GET", &[("host", host)]), "{host}");
        }
        for host in [
            "example.com",
            "localhost.example.com:8408",
            "192.168.7.6",
            "0.0.0.0",
            "",
            "a b",
            "127.0.0.1.nip.io",
            "user@127.0.0.1",
            "user@127.0.0.1:8408",
            "user:8408@localhost",
            "127.0.0.1@example.com",
            "@127.0.0.1",
            "127.0.0.1:",
            "127.0.0.1:+80",
            "127.0.0.1:65536",
            "127.0.0.1:80:80",
            "127.0.0.1:http",
            "127.0.0.1/",
            "127.0.0.1 ",
            "127.1",
            "2130706433",
            "localhost.",
            "localhost,127.0.0.1",
            "[localhost]",
            "[127.0.0.1]",
            "[::1",
            "::1",
            "[::1]8408",
            "[::1%25lo]:8408",
            "[::2]:8408",
        ] {
            assert!(!checked("GET", &[("host", host)]), "{host}");
            let target = format!("http://{host}/");
            if target.parse::<Uri>().is_ok_and(|target| target.authority().is_some_and(|target| target == host)) {
                let request = Request::builder().uri(target).header("host", "localhost").body(Body::empty());
                assert!(check(&request.expect("a request"), LOCAL.parse().expect("an address")).is_err(), "{host}");
            }
        }
        assert!(!checked("GET", &[]));
        assert!(!checked("GET", &[("host", "localhost"), ("host", "localhost")]));
    }

    #[test]
    fn origins() {
        let host = ("host", "127.0.0.1:8408");
        assert!(checked("POST", &[host, ("origin", "http://127.0.0.1:8408")]));
        for origin in ["http://127.0.0.1:3000", "https://127.0.0.1:8408", "http://localhost:8408", "null", "http://a.b"]
        {
            assert!(!checked("POST", &[host, ("origin", origin)]), "{origin}");
        }
        for (site, accepted) in [("same-origin", true), ("none", true), ("same-site", false), ("cross-site", false)] {
            assert_eq!(checked("POST", &[host, ("sec-fetch-site", site)]), accepted, "{site}");
            // A link to the panel on another site's page.
            assert!(checked("GET", &[host, ("sec-fetch-site", site)]), "{site}");
        }
    }
}
