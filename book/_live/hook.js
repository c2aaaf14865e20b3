// A button on each cell of the page; nothing more is fetched until one is used, or work was kept from last time.
{
  const here = document.currentScript.src, slow = new Map((document.currentScript.dataset.slow ?? "").split(",").map((s) => s.split(":")));
  const cells = [...document.querySelectorAll("div.cell")].filter((cell) => cell.querySelector(".cell_input pre"));
  const go = (cell) => import(new URL("live.js", here)).then((live) => live.open(cell), () =>
    document.querySelectorAll(".live-bar > span").forEach((span) => { span.textContent = "The editor could not be fetched."; }));
  if (location.protocol !== "file:" && typeof WebAssembly === "object") {
    cells.forEach((cell, n) => {
      const seconds = slow.get(String(n));
      const check = /tag_check-/.test(cell.className), answer = /tag_check-/.test(cells[n + 1]?.className);
      if (seconds === "0" || check) return;
      const bar = document.createElement("div"), button = document.createElement("button"), span = document.createElement("span");
      bar.className = "live-bar";
      button.type = "button";
      button.textContent = answer ? "Answer here" : "Edit and run";
      span.setAttribute("role", "status");
      span.textContent = seconds ? `takes about ${seconds} s here` : "";
      bar.append(button, span);
      button.addEventListener("click", () => { button.disabled = true; go(cell); });
      cell.querySelector(".cell_input").after(bar);
    });
    window.liveCells = cells;
    try { if (localStorage.getItem("answers " + location.pathname)) go(); } catch { /* a browser that keeps nothing */ }
  }
}
