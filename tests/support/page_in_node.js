// Runs a page's script in Node, on a document that has the page's elements and no layout, then the code of a test.
// Usage: node page_in_node.js PAGE.html CODE. CODE sees what the script declares, and prints.
"use strict";
const {readFileSync} = require("node:fs");
const [, , file, code] = process.argv;
const html = readFileSync(file, "utf8");

class Node_ {
  constructor(tag = "", attributes = {}) {
    Object.assign(this, {tag, attributes, children: [], listeners: {}, hidden: false, words: "", own: "", style: {setProperty() {}}});
    const classes = new Set();
    this.classList = {add: name => classes.add(name), contains: name => classes.has(name), toggle: (name, on) => on ? classes.add(name) : classes.delete(name)};
  }
  get id() { return this.attributes.id; }
  set id(name) { this.attributes.id = name; elements[name] = this; }
  get textContent() { return this.children.length ? this.children.map(each => each.textContent ?? String(each)).join("") : this.words; }
  set textContent(words) { this.children = []; this.words = String(words); }
  get parentElement() { return {clientWidth: 400}; }
  get options() { return this.children.flatMap(each => each.tag === "optgroup" ? each.children : [each]); }
  get value() { return this.tag === "select" ? this.options.findLast(each => each.selected)?.value ?? this.options[0]?.value : this.own; }
  set value(value) {
    this.own = String(value);
    if (this.tag === "select") for (const each of this.options) each.selected = each.value === this.own;
  }
  get valueAsNumber() { return this.own === "" ? NaN : Number(this.own); }
  get validity() { return {badInput: false}; }
  get selectedOptions() { return this.options.filter(each => each.selected); }
  append(...made) { this.children.push(...made.map(each => each instanceof Node_ ? each : Object.assign(new Node_("#text"), {words: String(each)}))); }
  replaceChildren(...made) { this.children = []; this.append(...made); }
  remove() {}
  setAttribute(name, value) { this.attributes[name] = String(value); }
  getAttribute(name) { return this.attributes[name] ?? null; }
  addEventListener(kind, heard) { this.listeners[kind] = heard; }
  // What a reader does: writes a value into a field, or chooses one.
  enter(value) { this.value = value; (this.listeners.change ?? this.listeners.input)({target: this}); }
  all() { return this.children.flatMap(each => [each, ...each.all()]); }
  querySelectorAll(selector) { return this.all().filter(each => `.${each.attributes.class}` === selector).map(each => Object.assign(each, {remove: () => { this.children = this.children.filter(other => other !== each); }})); }
  querySelector(selector) { return this.querySelectorAll(selector)[0] ?? null; }
  focus() {}
  scrollIntoView() {}
}

class Option extends Node_ {
  constructor(name, value, _, selected) {
    super("option");
    Object.assign(this, {words: name, own: value, selected: Boolean(selected)});
  }
}

const elements = {};
for (const [, tag, attributes] of html.matchAll(/<(\w+)((?:\s[^<>]*)?)>/g)) {
  const found = Object.fromEntries([...attributes.matchAll(/([\w-]+)="([^"]*)"/g)].map(([, name, value]) => [name, value]));
  if (found.id) elements[found.id] = Object.assign(new Node_(tag, found), {own: found.value ?? ""});
}
const json = html.match(/<script type="application\/json" id="explorer-data">([^]*?)<\/script>/)[1];
elements["explorer-data"].words = json;
const document = {
  getElementById: id => elements[id] ?? null,
  createElement: tag => new Node_(tag),
  createElementNS: (_, tag) => new Node_(tag),
  body: new Node_("body"),
  activeElement: null,
};
class ResizeObserver { observe() {} }
const script = html.match(/<script>([^]*?)<\/script>/)[1];
const names = ["document", "Option", "ResizeObserver", "location", "history", "matchMedia", "getComputedStyle", "addEventListener", "self", "top"];
const values = [document, Option, ResizeObserver, {hash: ""}, {replaceState() {}}, () => ({matches: true}), () => ({paddingLeft: "0", paddingRight: "0"}), () => {}, document, document];
Function(...names, `${script}\n${code}`)(...values);
