// A point's settings beside the pointer, at once; without this script the browser's own hint says the same after a while.
const tip = document.getElementById("tip");
for (const dot of document.querySelectorAll(".dot")) {
  const title = dot.querySelector("title");
  const text = title.textContent;
  dot.addEventListener("mouseenter", (event) => {
    title.textContent = "";
    tip.textContent = text;
    tip.style.display = "block";
    const left = Math.min(event.pageX + 14, window.scrollX + document.documentElement.clientWidth - tip.offsetWidth - 8);
    const top = Math.min(event.pageY + 14, window.scrollY + window.innerHeight - tip.offsetHeight - 8);
    tip.style.left = `${Math.max(left, 0)}px`;
    tip.style.top = `${Math.max(top, window.scrollY)}px`;
  });
  dot.addEventListener("mouseleave", () => {
    title.textContent = text;
    tip.style.display = "none";
  });
}
