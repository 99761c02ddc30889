// Code that is too wide is wrapped; what is drawn with lines, as tables are, becomes smaller, and then scrolls.
"use strict";

const SMALLEST = 7.5; // pixels

function fit() {
  for (const block of document.querySelectorAll("div.highlight pre")) {
    if (!/[│┃]/.test(block.textContent)) {
      block.classList.add("wrapped");
      continue;
    }
    block.style.fontSize = "";
    const style = getComputedStyle(block), padding = 2 * parseFloat(style.paddingLeft);
    const ratio = (block.clientWidth - padding) / (block.scrollWidth - padding);
    if (ratio < 1) block.style.fontSize = `${Math.max(parseFloat(style.fontSize) * ratio * 0.98, SMALLEST)}px`;
  }
}

document.addEventListener("DOMContentLoaded", fit);
addEventListener("resize", fit);
