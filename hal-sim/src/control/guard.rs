//! Which requests are refused, whatever they ask for: those of a name that somebody else has bound to this address (DNS
//! rebinding), and those of the pages of others.

use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;

use axum::Extension;
use axum::extract::Request;
use axum::http::uri::Authority;
use axum::http::{HeaderMap, HeaderName, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::connection::Connection;
use super::error::Failure;

const FETCH_SITE: HeaderName = HeaderName::from_static("sec-fetch-site");

/// Lets a request pass, or refuses it.
pub(super) async fn guard(Extension(connection): Extension<Arc<Connection>>, request: Request, next: Next) -> Response {
    match check(&request, connection.local()) {
        Ok(()) => next.run(request).await,
        Err(refusal) => Failure::Request(StatusCode::FORBIDDEN, refusal.to_owned()).into_response(),
    }
}

fn check(request: &Request, local: SocketAddr) -> Result<(), &'static str> {
    let headers = request.headers();
    let host = only(headers, &header::HOST)?.ok_or("a request without Host is refused")?;
    let host: Authority = host.parse().map_err(|_| "the Host is none")?;
    let target = request.uri().authority();
    if !is_own(&host, local.ip()) || target.is_some_and(|target| !is_own(target, local.ip())) {
        return Err("the Host is neither loopback nor the address of this server");
    }
    if let Some(origin) = only(headers, &header::ORIGIN)?
        && origin.strip_prefix("http://") != Some(host.as_str())
    {
        return Err("requests of other pages are refused");
    }
    match only(headers, &FETCH_SITE)? {
        Some("cross-site" | "same-site") if !request.method().is_safe() => Err("requests of other pages are refused"),
        _ => Ok(()),
    }
}

/// Returns the value of a header that must not be there twice.
fn only<'a>(headers: &'a HeaderMap, name: &HeaderName) -> Result<Option<&'a str>, &'static str> {
    let mut values = headers.get_all(name).iter();
    match (values.next(), values.next()) {
        (None, _) => Ok(None),
        (Some(value), None) => value.to_str().map(Some).map_err(|_| "a header is no text"),
        (Some(_), Some(_)) => Err("a header is there twice"),
    }
}

/// Returns whether a host is loopback, or the address that the connection was accepted at.
fn is_own(host: &Authority, local: IpAddr) -> bool {
    let name = host.host();
    let name = name.strip_prefix('[').and_then(|name| name.strip_suffix(']')).unwrap_or(name);
    match name.parse::<IpAddr>() {
        Ok(ip) => ip.is_loopback() || ip.to_canonical() == local.to_canonical(),
        Err(_) => name.eq_ignore_ascii_case("localhost"),
    }
}

#[cfg(test)]
mod tests {
    use axum::body::Body;

    use super::*;

    fn checked(method: &str, headers: &[(&str, &str)]) -> bool {
        let local = "192.168.7.5:8408".parse().expect("an address");
        let request = headers
            .iter()
            .fold(Request::builder().method(method).uri("/"), |request, (name, value)| request.header(*name, *value));
        check(&request.body(Body::empty()).expect("a request"), local).is_ok()
    }

    #[test]
    fn hosts() {
        for host in ["127.0.0.1:8408", "127.0.0.1", "localhost", "LocalHost:1", "[::1]:8408", "192.168.7.5:8408"] {
            assert!(checked("GET", &[("host", host)]), "{host}");
        }
        for host in
            ["example.com", "localhost.example.com:8408", "192.168.7.6", "0.0.0.0", "", "a b", "127.0.0.1.nip.io"]
        {
            assert!(!checked("GET", &[("host", host)]), "{host}");
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
            // A link to the panel on somebody's page.
            assert!(checked("GET", &[host, ("sec-fetch-site", site)]), "{site}");
        }
    }
}
