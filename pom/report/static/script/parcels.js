// ---- parcels: a page waits as gzip in base64: JSON (its text, what its plots need), a zero, then the traces ----------
// A trace is integers of 8, 16 or 32 bits in steps of the tolerance, differenced once or twice.
const KINDS = { int8: [Int8Array, 1, -(2 ** 7)], int16: [Int16Array, 2, -(2 ** 15)], int32: [Int32Array, 4, -(2 ** 31)] };
const opened = new Map();   // page -> { head, body }

// A long report keeps the parcel of a case in a file of its own, a script: pages from disk may load nothing else.
function load(file) {
  return new Promise((done, failed) => {
    const script = document.createElement("script");
    script.src = file;
    script.onload = () => { script.remove(); done(window.parcels[file]); };
    script.onerror = () => failed(new Error(`${file} is not next to report.html`));
    document.head.append(script);
  });
}
async function unpack(page) {
  if (opened.has(page)) return opened.get(page);
  const holder = $("script.parcel", page), { file } = holder.dataset;
  const packed = Uint8Array.from(atob(file ? await load(file) : holder.textContent), (c) => c.charCodeAt(0));
  if (file) delete window.parcels[file];
  const bytes = new Uint8Array(await new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer());
  const end = bytes.indexOf(0), text = new TextDecoder().decode(bytes.subarray(0, end < 0 ? bytes.length : end));
  const found = { head: JSON.parse(text), body: end < 0 ? null : bytes.buffer.slice(end + 1) };
  opened.set(page, found);
  return found;
}
// Put the text of a page, once unpacked, in its place.
function layOut(page) {
  const host = $(".body", page), found = opened.get(page);
  if (!found || host.firstChild) return;
  host.innerHTML = found.head.page;
  // The parcel of a case holds no title, so that a new title of the report leaves the parcels as they are.
  for (const node of host.querySelectorAll(".of-report")) node.textContent = $("#main").dataset.report;
}
// A browser that cannot unpack shows what readers without a script see.
function layOutPlain(page) {
  const plain = $("noscript", page), host = $(".body", page);
  if (plain && !host.firstChild) host.innerHTML = plain.textContent;
}
function restore(entry, body) {
  const [Kind, bytes, missing] = KINDS[entry.type], differences = new Kind(body.slice(entry.at, entry.at + entry.count * bytes));
  const values = new Array(entry.count);
  let level = entry.first, slope = 0;
  for (let i = 0; i < entry.count; i++) {
    if (differences[i] === missing) { values[i] = null; continue; }
    if (entry.order === 2) level += slope += differences[i]; else level += differences[i];
    values[i] = level * entry.step;
  }
  return values;
}
const restored = (entries, body) => Object.fromEntries(Object.entries(entries).map(([run, entry]) => [run, restore(entry, body)]));
// Return what the plots of an unpacked case show.
function dataOf(page) {
  const { head, body } = opened.get(page);
  const panels = head.panels.map((panel) => {
    const half = panel.half && restore(panel.half, body);
    return { ...panel, half, applied: half, counted: panel.exits, stated: panel.values, traces: restored(panel.traces, body), fans: restored(panel.fans, body) };
  });
  const crosses = head.crosses.map((cross) => {
    const half = restore(cross.half, body);
    return { ...cross, x: restored(cross.x, body), y: restored(cross.y, body), half, applied: half };
  });
  return { ...head, time: restore(head.time, body), panels, crosses };
}
