// ---- what the modules of the page of the identification share ----------------------------------------------------------
import { number } from "./core.js";

export const POINTS = 2000;   // samples on the screen
export let view = null;
export const setView = (one) => { view = one; };
export const place = (record, row) => `${record}|${row.start}|${row.end}`;
export const constant = (term) => term === "1" || numbered(term);
export const numbered = (term) => /^1\[/.test(term);   // the constant of one window: its number changes with the windows
export const short = (value, digits) => (value && Math.abs(value) < 1e-3 ? value.toExponential(digits - 1).replaceAll("-", "\u2212") : number(value, digits));
export const signed = (value) => (Math.abs(value) < 0.05 ? "0" : `${value > 0 ? "+" : "\u2212"}${Math.abs(value).toFixed(1)}`);
