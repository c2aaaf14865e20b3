// A button on each cell of the page; nothing more is fetched until one is used, or work was kept from last time.
{
  const { src, dataset } = document.currentScript;
  const slow = JSON.parse(dataset.slow); // cell -> seconds, 0 for one that takes too long to be offered
  const cells = [...document.querySelectorAll("div.cell")].filter((cell) => cell.querySelector(".cell_input pre"));
  const failed = () => {
    for (const span of document.querySelectorAll(".live-bar > span"))
      span.textContent = "The editor could not be fetched.";
  };
  const open = (cell) => import(new URL("live.js", src)).then((live) => live.open(cell), failed);
  const offer = (cell, n) => {
    if (slow[n] === 0 || cell.matches("[class*=tag_check-]")) return;
    const words = cells[n + 1]?.matches("[class*=tag_check-]") ? "Answer here" : "Edit and run";
    const status = slow[n] ? `takes about ${slow[n]} s here` : "";
    const bar = `<button type="button">${words}</button><span role="status">${status}</span>`;
    cell.querySelector(".cell_input").insertAdjacentHTML("afterend", `<div class="live-bar">${bar}</div>`);
    const button = cell.querySelector(".live-bar button");
    button.addEventListener("click", () => {
      button.disabled = true;
      open(cell);
    });
  };
  if (location.protocol !== "file:" && typeof WebAssembly === "object") {
    cells.forEach(offer);
    window.liveCells = cells;
    try {
      if (localStorage.getItem("answers " + location.pathname)) open();
    } catch {} // a browser that keeps nothing
  }
}
