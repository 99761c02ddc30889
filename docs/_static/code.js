// Code that is too wide is wrapped; what is drawn with lines, as tables are, becomes smaller, and then scrolls.
"use strict";

const SMALLEST = 0.6;

function fit() {
  for (const block of document.querySelectorAll("div.highlight pre")) {
    if (!/[│┃]/.test(block.textContent)) {
      block.classList.add("wrapped");
      continue;
    }
    block.style.fontSize = "";
    const ratio = block.clientWidth / block.scrollWidth;
    if (ratio < 1) block.style.fontSize = `${Math.max(ratio * 0.98, SMALLEST)}em`;
  }
}

document.addEventListener("DOMContentLoaded", fit);
addEventListener("resize", fit);
