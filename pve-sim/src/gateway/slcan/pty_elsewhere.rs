//! Systems without pseudo-terminals.

use crate::gateway::{Parse, Scheme};

/// The URL scheme of this gateway.
pub(in crate::gateway) const SCHEME: Scheme =
    Scheme { prefix: "slcan+pty:", form: "slcan+pty:PATH", parse: Parse::OnlyOn("Unix") };
