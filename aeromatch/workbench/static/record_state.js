// ---- what the modules of the page of the records share ---------------------------------------------------------------
export let view = null;
export const setView = (one) => { view = one; };
export const whole = () => [view.record.start, view.record.stop];
export const shown = () => view.span || whole();
export const place = ({ source, leaf, channel }) => `${source}/${leaf}/${channel}`;
export const rowText = (row) => [row.manoeuvre, row.control].filter(Boolean).join(" ");
// A line as an expression of the server: of a channel its leaf and name.
export const lineText = (line) => (line.source === "expression" ? line.channel : `${line.leaf}.${line.channel}`);
export const allLines = () => [...view.record.channels, ...view.expressions.filter((one) => !one.refused)];
export const chosenLines = () => allLines().filter((line) => view.chosen.has(place(line)));
