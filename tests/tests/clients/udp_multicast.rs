//! python-can's `udp_multicast` on the loopback of a kernel of its own: no machine's network sees a datagram.

use super::socketcan::on_a_kernel;

#[test]
fn python_can_and_another_simulator_are_in_the_group() {
    on_a_kernel("udp_multicast.py", "group");
}
