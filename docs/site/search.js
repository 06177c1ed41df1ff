// The search reads its index over HTTP, which a browser refuses for pages that are opened as files: say what helps.
if (location.protocol === "file:")
  document.addEventListener("DOMContentLoaded", () => {
    const said = "To search, serve this folder: python -m http.server";
    for (const field of document.querySelectorAll("input[name=query]")) field.placeholder = said;
    for (const place of document.querySelectorAll(".md-search-result__meta")) place.textContent = said;
  });
