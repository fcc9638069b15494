/** A plate from above: what each well holds, by address. */

import { Link, useSearchParams } from "react-router";
import { formatVolume } from "@/model/format";
import { fillShare } from "@/model/tree";
import type { Well, WellMap } from "@/model/wells";
import { words } from "./words";

const COLOURS = ["--p1", "--p2", "--p3", "--p4"] as const;
const OTHER = "--ink-3";
/** An amount that fills the well by less than this is drawn as this much, to be seen at all. */
const LEAST = 0.15;

/** Colour of a material on this plate: the four most plentiful have one of their own. */
function colourOf(map: WellMap, material: string): string {
  const place = map.materials.findIndex((one) => one.name === material);
  return `var(${COLOURS[place] ?? OTHER})`;
}

/** The parts of a well's contents as sectors of its disc. */
function sectors(map: WellMap, well: Well): string {
  const { contents, volume_nl } = well.row;
  let from = 0;
  const stops = contents.map(({ material, amount_nl }) => {
    const to = from + (amount_nl / volume_nl) * 100;
    const stop = `${colourOf(map, material)} ${from.toFixed(1)}% ${to.toFixed(1)}%`;
    from = to;
    return stop;
  });
  return `conic-gradient(${stops.join(", ")})`;
}

function describe(well: Well): string {
  const { row, address } = well;
  if (!row.holds_liquid) return `${address}: ${well.isTaken ? "taken" : "free"}`;
  if (!row.volume_nl) return `${address}: empty`;
  const parts = row.contents.map((part) => `${part.material} ${formatVolume(part.amount_nl)}`);
  return `${address}: ${parts.join(", ")}`;
}

export function WellGrid({ map, picked }: { map: WellMap; picked: string | null }) {
  const [params] = useSearchParams();
  const link = (id: string): string => {
    const at = params.get("at");
    return `/lab?${new URLSearchParams({ sel: id, ...(at ? { at } : {}) }).toString()}`;
  };
  return (
    <figure className="wellmap" data-testid="well-map">
      <div className="scroll">
        <table>
          <caption className="vh">{words.wells.caption}</caption>
          <thead>
            <tr>
              <td />
              {map.numbers.map((number) => (
                <th key={number} scope="col" className="num">
                  {number}
                </th>
              ))}
            </tr>
          </thead>
          <tbody>
            {map.letters.map((letter) => (
              <tr key={letter}>
                <th scope="row">{letter}</th>
                {map.numbers.map((number) => (
                  <Cell
                    key={number}
                    map={map}
                    well={map.at.get(`${letter}${number}`)}
                    picked={picked}
                    link={link}
                  />
                ))}
              </tr>
            ))}
          </tbody>
        </table>
      </div>
      <Legend map={map} />
    </figure>
  );
}

function Cell(props: {
  map: WellMap;
  well: Well | undefined;
  picked: string | null;
  link: (id: string) => string;
}) {
  const { map, well } = props;
  if (!well) return <td />;
  const { row } = well;
  const share = row.volume_nl ? Math.max(LEAST, fillShare(row) ?? 1) : 0;
  const text = describe(well);
  return (
    <td>
      <Link
        className="well"
        to={props.link(row.id)}
        replace
        title={text}
        aria-label={text}
        aria-current={row.id === props.picked ? "true" : undefined}
        data-state={row.is_quarantined ? "doubt" : well.isTaken ? "taken" : undefined}
        data-well={well.address}
      >
        {share > 0 && (
          <i style={{ background: sectors(map, well), transform: `scale(${Math.sqrt(share)})` }} />
        )}
      </Link>
    </td>
  );
}

function Legend({ map }: { map: WellMap }) {
  if (!map.materials.length) return null;
  return (
    <figcaption>
      <ul className="welllegend">
        {map.materials.map(({ name, amount_nl }) => (
          <li key={name}>
            <i style={{ background: colourOf(map, name) }} />
            {name}
            <span className="m num">{formatVolume(amount_nl)}</span>
          </li>
        ))}
      </ul>
    </figcaption>
  );
}
