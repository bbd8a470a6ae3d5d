// Drawing: at most once per animation frame, and only the requested parts.

const parts = new Set();
let isAsked = false;

/** Requests one call of a part's `render(at)` in the next animation frame; further requests have no effect. */
export function paint(part) {
  parts.add(part);
  if (isAsked) return;
  isAsked = true;
  requestAnimationFrame((at) => {
    isAsked = false;
    const now = [...parts];
    parts.clear();
    for (const each of now) each.render(at);
  });
}
