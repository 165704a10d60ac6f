/** Light or dark: as the system says, or as a person does; and which panel a phone shows. */

import { mapColours } from "./colours.js";

const MODES = ["auto", "light", "dark"],
  KEPT_AS = "mapod.theme";
const by = (id) => document.getElementById(id);

export class Theme extends EventTarget {
  /** Events: `change`. */
  constructor() {
    super();
    this.system = matchMedia("(prefers-color-scheme: dark)");
    this.mode = kept() ?? "auto";
    this.system.addEventListener("change", () => this.apply());
    by("theme").addEventListener("click", () => this.next());
    this.apply();
  }

  /** What pictures made of these colours are kept under. */
  get key() {
    return this.is_dark ? "dark" : "light";
  }

  next() {
    this.mode = MODES[(MODES.indexOf(this.mode) + 1) % MODES.length];
    try {
      localStorage.setItem(KEPT_AS, this.mode);
    } catch {
      // a browser that keeps nothing: the choice holds until the page closes
    }
    this.apply();
  }

  /** Asks the system here alone: a browser that is asked between two frames tells no change. */
  apply() {
    this.is_dark = this.mode === "dark" || (this.mode === "auto" && this.system.matches);
    document.documentElement.dataset.theme = this.key;
    by("theme").textContent = `Theme: ${this.mode}`;
    this.colours = { ...mapColours(), is_dark: this.is_dark };
    this.dispatchEvent(new Event("change"));
  }
}

function kept() {
  try {
    const mode = localStorage.getItem(KEPT_AS);
    return MODES.includes(mode) ? mode : null;
  } catch {
    return null;
  }
}

/** On a narrow screen one panel is shown at a time. Arrow keys go from tab to tab. */
export function listenToTabs() {
  const tabs = [...by("tabs").querySelectorAll("[role=tab]")];
  const choose = (tab) => {
    document.body.dataset.tab = tab.dataset.tab;
    for (const each of tabs) {
      each.setAttribute("aria-selected", each === tab);
      each.tabIndex = each === tab ? 0 : -1;
    }
  };
  tabs.forEach((tab, k) => {
    tab.addEventListener("click", () => choose(tab));
    tab.addEventListener("keydown", ({ key }) => {
      const way = { ArrowRight: 1, ArrowLeft: -1 }[key];
      if (way === undefined) return;
      const next = tabs[(k + way + tabs.length) % tabs.length];
      choose(next);
      next.focus();
    });
  });
  choose(tabs[0]);
}
