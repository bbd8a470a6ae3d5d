//! The kinds of messages that a node sends by itself or on request. At most one message of each kind is pending.

/// A kind of message. Kinds are listed in the order of arbitration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Message {
    /// The cyclic report of the product.
    Report,
    /// The claim or cannot-claim.
    Claim,
    /// DM1.
    Dm1,
    /// DM2.
    Dm2,
    /// The next frame of a multi-packet broadcast.
    Packet,
}

impl Message {
    /// All kinds of messages, in the order of arbitration.
    pub(super) const ALL: [Self; 5] = [Self::Report, Self::Claim, Self::Dm1, Self::Dm2, Self::Packet];

    const fn bit(self) -> u8 {
        1 << self as u8
    }
}

/// A set of kinds of messages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct MessageSet(u8);

impl MessageSet {
    pub(super) const EMPTY: Self = Self(0);
    pub(super) const CLAIM: Self = Self(Message::Claim.bit());
    pub(super) const DM1: Self = Self(Message::Dm1.bit());
    /// The messages that outlast bus-off.
    pub(super) const LASTING: Self = Self::CLAIM.union(Self::DM1);
    pub(super) const ALL: Self = Self(0xFF);

    #[inline]
    pub(super) const fn is_empty(self) -> bool {
        self.0 == 0
    }

    #[inline]
    pub(super) const fn contains(self, message: Message) -> bool {
        self.0 & message.bit() != 0
    }

    #[inline]
    pub(super) const fn insert(&mut self, message: Message) {
        self.0 |= message.bit();
    }

    #[inline]
    pub(super) const fn remove(&mut self, message: Message) {
        self.0 &= !message.bit();
    }

    /// Returns the most urgent message.
    #[inline]
    pub(super) fn first(self) -> Option<Message> {
        Message::ALL.into_iter().find(|message| self.contains(*message))
    }

    pub(super) const fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    pub(super) const fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    #[inline]
    pub(super) const fn intersection(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }
}
